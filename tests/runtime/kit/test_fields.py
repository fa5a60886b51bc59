"""Fields of servers written with the kit: their age, and what they cannot be."""

from __future__ import annotations

import math
from typing import Any

import pytest

from colony.runtime.kit.description import MAX_AGE_NS, FieldReader, Reading, field
from colony.runtime.kit.once import exception_text
from colony.runtime.protocol.messages import Sample
from tests.kit.node_stage import MS

NOW_NS = 10_000 * MS

# --- what a read returns ---------------------------------------------------------------------------------


def read(returned: object, **declared: Any) -> tuple[Sample | None, list[str]]:
    """The sample of one frame, and what two frames reported."""
    reports: list[str] = []
    reader = FieldReader("S", [field("f", lambda: returned, **declared)], reports.append)  # type: ignore[arg-type, return-value]
    samples = [reader.read(NOW_NS)["f"] for _ in range(2)]
    assert repr(samples[0]) == repr(samples[1])
    return samples[0], reports


GOOD = [
    (0.5, {}, Sample(0.5, NOW_NS)),
    (3, {}, Sample(3.0, NOW_NS)),
    (math.inf, {}, Sample(math.inf, NOW_NS)),
    (10**400, {}, Sample(math.inf, NOW_NS)),
    (True, {"boolean": True}, Sample(True, NOW_NS)),
    ([1, 2.5], {"size": 2}, Sample((1.0, 2.5), NOW_NS)),
    ((True, False), {"size": 2, "boolean": True}, Sample((True, False), NOW_NS)),
    (1.5, {"unit": "m"}, Sample(1500.0, NOW_NS)),
    (50, {"unit": "percent"}, Sample(0.5, NOW_NS)),
    ([1, 2.5], {"size": 2, "unit": "Wh"}, Sample((3600.0, 9000.0), NOW_NS)),
    (Reading(2.0, 1), {"has_age": True, "unit": "kg"}, Sample(2e-6, NOW_NS - 1)),
    (None, {}, None),
    (None, {"has_age": True}, None),
    (Reading(0.5, 0), {"has_age": True}, Sample(0.5, NOW_NS)),
    (Reading(0.5, 300 * MS), {"has_age": True}, Sample(0.5, NOW_NS - 300 * MS)),
    (Reading((1.0, 2.0), 1), {"has_age": True, "size": 2}, Sample((1.0, 2.0), NOW_NS - 1)),
    (Reading(0.5, 2**100), {"has_age": True}, Sample(0.5, NOW_NS - MAX_AGE_NS)),
]


@pytest.mark.parametrize(("returned", "declared", "published"), GOOD)
def test_a_value_is_published_with_the_time_at_which_it_was_measured(
    returned: object, declared: dict[str, Any], published: Sample | None
) -> None:
    found, reports = read(returned, **declared)
    assert repr(found) == repr(published)
    assert reports == []


BAD = [
    (math.nan, {}, "returned NaN; expected a number, or None"),
    ((1.0, math.nan), {"size": 2}, "returned NaN"),
    ("full", {}, "returned 'full'; expected a number"),
    (True, {}, "returned True; expected a number"),
    (1.0, {"boolean": True}, "returned 1.0; expected True or False"),
    (1.0, {"size": 2}, "returned 1.0; expected a list or tuple of 2"),
    ((1.0,), {"size": 2}, "returned 1 elements; expected 2"),
    ((1.0, 2.0), {}, "returned (1.0, 2.0); expected a number"),
    (Reading(0.5, 0), {}, "returned a Reading; declare the field with has_age=True"),
    (0.5, {"has_age": True}, "returned 0.5; expected Reading(value, age_ns), because it has an age"),
    (Reading(math.nan, 0), {"has_age": True}, "returned NaN"),
    (Reading(0.5, -1), {"has_age": True}, "has an age of -1 ns: a reading from the future"),
    (Reading(0.5, 1.5), {"has_age": True}, "has an age of 1.5; expected whole nanoseconds"),  # type: ignore[arg-type]
    (Reading(0.5, math.nan), {"has_age": True}, "has an age of nan; expected whole nanoseconds"),  # type: ignore[arg-type]
    (Reading(0.5, None), {"has_age": True}, "has an age of None; expected whole nanoseconds"),  # type: ignore[arg-type]
    (Reading(0.5, True), {"has_age": True}, "has an age of True; expected whole nanoseconds"),
]


@pytest.mark.parametrize(("returned", "declared", "problem"), BAD)
def test_what_a_field_cannot_be_is_no_value_and_is_reported_once(
    returned: object, declared: dict[str, Any], problem: str
) -> None:
    found, reports = read(returned, **declared)
    assert found is None
    [report] = reports
    assert report.startswith(f"S.f {problem}")


def test_each_kind_of_problem_is_reported_once_for_each_field() -> None:
    steps = iter(
        [1.0, KeyError("a"), KeyError("b"), OSError("c"), math.nan, "x", math.nan, KeyError("d"), 2.0]
    )

    def failing() -> float:
        step = next(steps)
        if isinstance(step, Exception):
            raise step
        return step  # type: ignore[return-value]

    reports: list[str] = []
    fields = [field("f", failing), field("g", lambda: math.nan), field("h", lambda: 1.0)]
    reader = FieldReader("S", fields, reports.append)
    frames = [reader.read(NOW_NS) for _ in range(9)]
    assert [frame["f"] and frame["f"].value for frame in frames] == [1.0, *[None] * 7, 2.0]
    assert all(frame["h"] == Sample(1.0, NOW_NS) for frame in frames)
    firsts = [report.splitlines()[0] for report in reports]
    assert [text.split(" ")[0] for text in firsts] == ["S.g", "S.f", "S.f", "S.f", "S.f"]
    assert "KeyError: 'a'" in reports[1]
    assert "OSError: c" in reports[2]


def test_an_exception_may_have_no_text() -> None:
    class UnprintableError(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    assert exception_text(ValueError("full")) == "full"
    assert exception_text(UnprintableError()) == "(an exception without a text)"


# --- what is declared ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("declared", "reason"),
    [
        ({"name": ""}, "found the field ''; expected a name"),
        ({"name": "a b"}, "found the field 'a b'"),
        ({"name": "1st"}, "expected a name of letters, digits and `_`"),
        ({"name": "höhe"}, "expected a name"),
        ({"name": "a\n"}, "expected a name"),
        ({"name": 3}, "found the field 3"),
        ({"size": 0}, "f: found the size 0; expected 1 to 4096"),
        ({"size": -1}, "expected 1 to 4096"),
        ({"size": 4097}, "expected 1 to 4096"),
        ({"size": 2.0}, "found the size 2.0"),
        ({"size": True}, "found the size True"),
        ({"size": "3"}, "found the size '3'"),
        ({"unit": "parsec"}, "`parsec` is not a unit"),
    ],
)
def test_mistakes_in_fields(declared: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        field(**{"name": "f", "read": lambda: 0.0, **declared})


def test_fields_of_a_server_have_different_names() -> None:
    fields = [field("a", lambda: 0.0, size=4096), field("b", lambda: 0.0), field("a", lambda: 0.0)]
    with pytest.raises(ValueError, match="S: found two fields `a`"):
        FieldReader("S", fields, print)
