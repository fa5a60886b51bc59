"""Readings of every kind, sensors of every range: all executors take them in alike."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import pytest

from colony.compile.backends.python.decision import _if
from colony.dsl.load import load_text
from colony.execute.intake import members, stand_in
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.verify.testing.agreement import client_disagreement, disagreement
from tests.programs import generated
from tests.sampling import sampled

TEXT = """
enum goal {{ none = 0, corner = 67, light = -3 }}
robot r {{
  sensor s{size} : {kind} {default} from DServer.s
  actuator out {{ v : number, b : bool }} to DServer.out idle hold
}}
module m {{ when {when} do out(v = {value}, b = fresh(s)) }}
module n {{ when true do out(v = 1, b = fresh(s)) }}
network {{ out = m suppresses n }}
"""
BOUNDS: tuple[float | None, ...] = (None, -2.0, 3.0)
ODD: tuple[object, ...] = (
    *(None, True, False, 0, 1, -1, 2.5, -0.0, 0.0, 3.0, -2.0, 67, 67.0, -3.0, 5, 1e308, -1e308),
    *(math.nan, math.inf, -math.inf, 10**400, -(10**400), "1", b"1", [], [1.0], (2.5,), {}),
)


def program(kind: str, size: int | None, default: str = "") -> Program:
    scalar = "s" if size is None else f"s[{size - 1}]"
    value = {"bool": f"if {scalar} then 2 else 3", "goal": f"if {scalar} == goal.light then 2 else 3"}
    return load_text(
        TEXT.format(
            size="" if size is None else f"[{size}]",
            kind=kind,
            default=f"default {default}" if default else "",
            when=f"{scalar} or not {scalar}" if kind == "bool" else f"{scalar} == {scalar}",
            value=value.get(kind, f"{scalar} / 1 m" if kind == "m" else scalar),
        )
    )


def bounded(of: Program, low: float | None, high: float | None) -> Program:
    (sensor,) = of.robot.sensors
    return replace(of, robot=replace(of.robot, sensors=(replace(sensor, low=low, high=high),)))


def readings(size: int | None) -> Iterator[object]:
    yield from ODD
    if size is not None:
        for one in ODD:
            for make in (list, tuple):
                yield make([one] * size)
                yield make([1.0] * (size - 1) + [one])
                yield make([True] * (size - 1) + [one])
        yield [1.0] * (size + 1)
        yield (False,) * size


def agree(of: Program, size: int | None) -> None:
    trace = [Frame(k, {"s": value}) for k, value in enumerate(readings(size))]  # type: ignore[dict-item]
    trace.append(Frame(len(trace), {}))
    found = disagreement(of, trace) or client_disagreement(of, trace)
    assert found is None, str(found).splitlines()[-3:]


@pytest.mark.parametrize("size", sampled([None, 2, 1, 5], every=4))
@pytest.mark.parametrize("kind", ["number", "m"])
def test_numbers(kind: str, size: int | None) -> None:
    for low, high in product(BOUNDS, BOUNDS):
        if low is None or high is None or low <= high:
            agree(bounded(program(kind, size), low, high), size)


@pytest.mark.parametrize("size", [None, 1, 3])
@pytest.mark.parametrize(
    ("kind", "default"),
    [("bool", ""), ("bool", "true"), ("goal", ""), ("goal", "goal.light"), ("number", "2")],
)
def test_bools_members_and_defaults(kind: str, default: str, size: int | None) -> None:
    agree(program(kind, size, default), size)


@pytest.mark.parametrize(
    ("kind", "low", "high", "expected"),
    [
        ("number", None, None, "if type(s) is float and s == s:"),
        ("number", -2.0, 3.0, "if type(s) is float and -2.0 <= s <= 3.0:"),
        ("number", -2.0, None, "if type(s) is float and -2.0 <= s:"),
        ("number", None, 3.0, "if type(s) is float and s <= 3.0:"),
        ("m", None, None, "if type(reading) is float and (s := reading * 1000.0) == s:"),
        ("m", None, 3.0, "if type(reading) is float and (s := reading * 1000.0) == s and s <= 3.0:"),
        ("bool", None, None, "if s is True or s is False:"),
        ("goal", None, None, "if type(s) is float and s in (0.0, 67.0, -3.0):"),
    ],
)
def test_the_quick_test_of_a_scalar(kind: str, low: float | None, high: float | None, expected: str) -> None:
    of = bounded(program(kind, None), low, high)
    assert f"        {expected}\n" in generated(of)


def test_conditions_of_the_longest_length() -> None:
    just, longer = ["a" * 50, "b" * 37], ["a" * 50, "b" * 38]
    assert _if(just) == [f"if {just[0]} and {just[1]}:"]
    assert len(_if(just)[0]) == 96
    assert _if(longer) == ["if (", f"    {longer[0]}", f"    and {longer[1]}", "):"]


def test_what_stands_in_lies_in_the_range() -> None:
    for (low, high), expected in (
        ((None, None), 0.0),
        ((1.0, None), 1.0),
        ((None, -1.0), -1.0),
        ((2.0, 3.0), 2.0),
        ((-3.0, -2.0), -2.0),
    ):
        (sensor,) = bounded(program("number", None), low, high).robot.sensors
        assert stand_in(sensor) == expected
        assert members(sensor) is None
    (sensor,) = program("goal", 3).robot.sensors
    assert (stand_in(sensor), members(sensor)) == ((0.0,) * 3, (0.0, 67.0, -3.0))
    (sensor,) = program("bool", 2, "true").robot.sensors
    assert stand_in(sensor) == (True, True)
    (sensor,) = program("bool", None).robot.sensors
    assert stand_in(sensor) is False
