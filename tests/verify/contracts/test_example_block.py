"""A written test is a test of the language, and its frames are the counterexample's."""

from __future__ import annotations

import pytest

from colony.dsl.load import load_text
from colony.ir.types import Value
from colony.verify.contracts.concrete_runs import Replay
from colony.verify.contracts.example_block import example_block
from colony.verify.contracts.results import Trace
from colony.verify.snapshot import Snapshot
from colony.verify.testing.examples import run_examples
from colony.verify.testing.frames import snapshots_of
from tests.verify.contracts.behaviors import ROBOT, program

RAYS = (1000.0, 2000.0, 3000.0, 4000.0, 5000.0, 6000.0)


def trace(*frames: dict[str, Value]) -> Trace:
    return Trace(
        snapshots=tuple(Snapshot(t_ns=i * 50_000_000, readings=f) for i, f in enumerate(frames)), outcomes=()
    )


def block(*frames: dict[str, Value]) -> str | None:
    made = program("contract c: true")
    return example_block(made, made.contracts[0], trace(*frames))


def steps(*frames: dict[str, Value]) -> list[str]:
    text = block(*frames)
    assert text.startswith('test "counterexample: c" {\n')
    return [line.strip() for line in text.splitlines()[1:-1]]


def test_only_what_changes_is_given() -> None:
    assert steps({"bump": True, "far": 500.0}, {"bump": True, "far": 1500.0}, {"bump": True}) == [
        "at 0 s given far = 0.5 m, bump = true",
        "at 0.05 s given far = 1.5 m",
        "at 0.1 s given far = missing",
    ]


def test_enumerators_are_named() -> None:
    assert steps({"want": 76.0}) == ["at 0 s given want = goal.light"]


def test_arrays_are_one_value_with_exceptions_or_element_by_element() -> None:
    few = (1000.0, 1000.0, 250.0, 1000.0, 1000.0, 1000.0)
    assert steps({"rays": few}) == ["at 0 s given rays = 1 m, rays[2] = 0.25 m"]
    assert steps({"rays": few}, {"rays": (1000.0,) * 6})[1] == "at 0.05 s given rays[2] = 1 m"
    assert steps({"rays": RAYS}) == [
        "at 0 s given rays = 1 m, rays[1] = 2 m, rays[2] = 3 m, rays[3] = 4 m, rays[4] = 5 m, rays[5] = 6 m"
    ]


def read_again(rays: str, *readings: Value) -> tuple[str, list[Value]]:
    """Return the test that is written of readings of another array of rays, and what it gives."""
    text = ROBOT.replace("rays[6] : m range", f"{rays} range") + "contract c: rays[1] > rays[0]"
    made = load_text(text)
    block = example_block(made, made.contracts[0], trace(*({"rays": reading} for reading in readings)))
    again = load_text(f"{text}\n{block}")
    return block, [s.readings["rays"] for s in snapshots_of(again, again.tests[0])]


@pytest.mark.parametrize(
    ("bearing", "index"),
    [
        ("bearing -75 deg step 25 deg", "-25 deg"),
        ("bearing 0 deg step -22.5 deg", "-45 deg"),
        ("bearing 10 deg step 51.42857 deg", "112.857 deg"),
        ("bearing [0 deg, 90 deg, 0 deg, 5 deg, 5 deg, 5 deg]", "2"),
    ],
)
def test_elements_are_given_by_angle_where_that_reads_back(bearing: str, index: str) -> None:
    readings: Value = (1000.0, 1000.0, 250.0, 1000.0, 1000.0, 1000.0)
    block, again = read_again(f"rays[6] : m {bearing}", readings)
    assert f"rays[{index}] = 0.25 m" in block
    assert again == [readings]


@pytest.mark.parametrize(
    ("bearing", "size", "place"),
    [
        ("bearing -180 deg", 90, "44 deg .. 68 deg"),
        ("bearing 90 deg step -2 deg", 90, "-34 deg .. -22 deg"),
        ("", 90, "56 .. 62"),
    ],
)
def test_runs_are_given_as_slices(bearing: str, size: int, place: str) -> None:
    near: Value = tuple(250.0 if 56 <= i <= 62 else 1000.0 for i in range(size))
    nearer: Value = tuple(250.0 if 56 <= i <= 70 else 1000.0 for i in range(size))
    block, again = read_again(f"rays[{size}] : m {bearing}", near, nearer)
    assert f"given rays = 1 m, rays[{place}] = 0.25 m" in block
    assert again == [near, nearer]


def test_an_infinite_reading_cannot_be_written() -> None:
    assert block({"x": float("inf")}) is None


def test_answers_of_python_modules_cannot_be_written() -> None:
    found = Trace(snapshots=(Snapshot(t_ns=0, answers={"guess": (1.0,)}),), outcomes=())
    made = program("contract c: true")
    assert example_block(made, made.contracts[0], found) is None


def test_the_written_test_of_what_cannot_be_told_leaves_it_missing() -> None:
    made = program("contract c: x < 1")
    text = example_block(made, made.contracts[0], trace({"x": 0.5}, {}))
    assert text is not None
    [result] = run_examples(program(f"contract c: x < 1\n{text}"))
    assert [(f.kind, f.t_ns) for f in result.failures] == [("contract unknown", 50_000_000)]


@pytest.mark.parametrize(
    ("contract", "frames"),
    [
        ("not (fresh(bump) and min(rays) < 2 m and bump)", [{"rays": RAYS}, {"rays": RAYS, "bump": True}]),
        ("not falling(bump)", [{"bump": True}, {"bump": False}]),
        ("want != goal.corner", [{"want": 67.0}]),
        ("fresh(x) or not previous(fresh(x), false)", [{"x": -0.1}, {}]),
        ("x < 0.30000000000000004", [{"x": 0.30000000000000004}]),
        ("slope < 57.29577951308233 deg", [{"slope": 57.29577951308233}]),
        ("not (last.drive by back)", [{"last.drive by back": True}]),
        (
            "last.back is active or not (last.drive by cruise)",
            [
                {"last.back is active": True, "last.drive by cruise": True},
                {"last.back is active": False, "last.drive by cruise": True},
            ],
        ),
    ],
)
def test_the_written_test_breaks_the_contract_where_the_trace_does(
    contract: str, frames: list[dict[str, Value]]
) -> None:
    made = program(f"contract c: {contract}")
    found = trace(*frames)
    assert Replay(made, "c").breaks(found.snapshots)
    text = example_block(made, made.contracts[0], found)
    assert text is not None
    [result] = run_examples(program(f"contract c: {contract}\n{text}"))
    assert [(f.kind, f.t_ns) for f in result.failures] == [("contract broken", found.snapshots[-1].t_ns)]
