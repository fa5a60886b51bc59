"""Margins: bounds that are known by hand, held to runs of the program as it is written."""

from __future__ import annotations

from functools import cache
from random import Random
from typing import Any

import pytest

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.verify.contracts.margins import Margin, amount_text, margin_lines, margins, with_disturbed
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import ProofOptions
from colony.verify.contracts.solver import Deadline
from colony.verify.reference.interpreter import Interpreter

_TEXT = """
robot rover {
  frame 50 ms
  sensor bumper : bool from RServer.bumper within 300 ms
  sensor range[3] : m range 0 .. 5 from PServer.range within 500 ms
  actuator drive { velocity : mm/s range -400 .. 400 } to RServer.drive idle drive(velocity = 0)
}
let ahead = min(range)
module cruise { when true do drive(velocity = 300 mm/s) }
failsafe module slow { when ahead < 1.2 m do drive(velocity = 100 mm/s) }
failsafe module back_off { when bumper do drive(velocity = -100 mm/s) }
network { drive = back_off suppresses slow suppresses cruise }
contract near: ahead < 1 m implies drive.velocity <= 100 mm/s
contract rams: bumper implies drive.velocity <= 0
contract soon: bumper and previous(bumper, false) and previous(previous(bumper, false), false)
  implies drive.velocity <= 0
contract fast: drive.velocity <= 300 mm/s
"""


@cache
def _program() -> Program:
    return load_text(_TEXT)


@cache
def _margins() -> dict[tuple[str, str, str], Margin]:
    program = _program()
    found = margins(program, list(prove_contracts(program)), ProofOptions(), Deadline())
    return {(m.contract.name, m.sensor.name, m.kind): m for m in found}


def test_margins_are_those_that_are_known_by_hand() -> None:
    ends = {key: (m.proved, m.refuted) for key, m in _margins().items()}
    proved, refuted = ends.pop(("near", "range", "wrong"))
    assert refuted is not None
    assert 190 <= proved < 200 < refuted <= 210  # 1.2 m against 1 m
    assert ends == {
        ("near", "range", "late"): (0, 1),
        ("near", "range", "rare"): (1, 2),
        ("rams", "bumper", "late"): (0, 1),
        ("rams", "bumper", "rare"): (1, 2),
        ("soon", "bumper", "late"): (2, 3),
        ("soon", "bumper", "rare"): (3, 4),
    }


@pytest.mark.parametrize(
    "key", [("near", "range", "wrong"), ("soon", "bumper", "late"), ("soon", "bumper", "rare")]
)
def test_no_drawn_run_breaks_what_is_proved(key: tuple[str, str, str]) -> None:
    margin, random, tried = _margins()[key], Random(0), 0
    for _ in range(300):
        reader, interpreter, bumps = _Reader(margin, random), Interpreter(_program()), list[bool]()
        for k in range(12):
            true = tuple(random.uniform(800, 1500) for _ in range(3))
            bumps.append(random.random() < 0.8)
            seen = {"range": true, "bumper": bumps[-1]}
            seen[margin.sensor.name] = reader.seen(seen[margin.sensor.name])
            velocity = interpreter.step_in_base_units(k * 50_000_000, seen).commands["drive"].values[0]
            if margin.contract.name == "near" and min(true) < 1000:
                tried += 1
                assert velocity <= 100
            if margin.contract.name == "soon" and len(bumps) > 2 and all(bumps[-3:]):
                tried += 1
                assert velocity <= 0
    assert tried > 500


class _Reader:
    """Draws what the program sees, within what is proved. Stateful: remembers the true readings."""

    def __init__(self, margin: Margin, random: Random) -> None:
        self._margin, self._random = margin, random
        self._true: list[Any] = []
        self._age = 0

    def seen(self, true: Any) -> Any:
        self._true.append(true)
        random, most, count = self._random, self._margin.proved, len(self._true)
        if self._margin.kind == "wrong":
            return tuple(x + random.choice((-most, most, random.uniform(-most, most))) for x in true)
        if self._margin.kind == "late":
            return self._true[-1 - min(random.randint(0, int(most)), count - 1)]
        self._age = self._age + 1 if self._age + 1 < min(most, count) and random.random() < 0.9 else 0
        return self._true[-1 - self._age]


def test_the_run_at_the_end_of_a_margin_replays_in_the_program_as_written() -> None:
    margin = _margins()["near", "range", "wrong"]
    assert margin.trace is not None
    interpreter = Interpreter(_program())
    for snapshot, outcome in zip(margin.trace.snapshots, margin.trace.outcomes, strict=True):
        true, error = snapshot.readings["range"], snapshot.readings.get("range error") or (0.0,) * 3
        assert isinstance(true, tuple)
        assert isinstance(error, tuple)
        assert max(map(abs, error)) <= (margin.refuted or 0.0)
        seen = tuple(min(max(x + e, 0.0), 5000.0) for x, e in zip(true, error, strict=True))
        readings = {"range": seen, "bumper": snapshot.readings.get("bumper")}
        decided = interpreter.step_in_base_units(snapshot.t_ns, readings)
        assert decided.decisions == outcome.decisions
    assert min(true) < 1000
    assert decided.commands["drive"].values[0] > 100


def test_late_readings_are_those_of_frames_before_and_rare_ones_stand() -> None:
    program, sensor = _program(), next(s for s in _program().robot.sensors if s.name == "range")
    for kind, name, given, expected in (
        ("late", "range age", (0.0, 1.0, 2.0, 0.0), (1.0, 1.0, 1.0, 4.0)),
        ("rare", "range skipped", (False, True, True, True), (1.0, 1.0, 1.0, 4.0)),
    ):
        changed = with_disturbed(program, sensor, kind, 2 + (kind == "rare"))  # type: ignore[arg-type]
        interpreter = Interpreter(changed)
        for k, (free, seen) in enumerate(zip(given, expected, strict=True)):
            interpreter.step_in_base_units(k, {"range": (k + 1.0,) * 3, name: free})
            assert interpreter.values.derived["range seen"] == (seen,) * 3
            assert interpreter.values.derived["true ahead"] == k + 1
        interpreter.step_in_base_units(9, {"range": None, name: given[-1]})
        assert "range seen" not in interpreter.values.derived


def test_a_limit_leaves_margins_open_and_says_so() -> None:
    program = _program()
    found = list(margins(program, list(prove_contracts(program)), ProofOptions(), Deadline(1)))
    assert not any(m.is_complete or m.refuted is not None for m in found)
    assert all("(limit reached)" in line for line in list(margin_lines(found))[1:])


def test_amounts_are_written_in_the_unit_of_the_sensor() -> None:
    texts = [amount_text(m, m.proved) for m in _margins().values()]
    assert texts[:3] == ["± 0.19 m", "late by 0 readings", "every reading"]


def test_margins_are_those_of_runs_that_meet_the_assumptions() -> None:
    program = load_text(_TEXT + "assume dry: not bumper\n")
    found = list(margins(program, list(prove_contracts(program)), ProofOptions(), Deadline()))
    assert {m.sensor.name for m in found} == {"range"}
    assert {m.contract.assuming for m in found} == {("dry",)}


def test_an_angle_of_a_full_circle_goes_around_it() -> None:
    program = load_text(
        """
robot r {
  frame 50 ms
  sensor heading : deg range 0 .. 360 from RServer.heading within 300 ms
  actuator drive { velocity : mm/s range 0 .. 400 } to RServer.drive idle drive(velocity = 0)
}
module north { when heading < 10 deg do drive(velocity = 50 mm/s) }
module other { when true do drive(velocity = 200 mm/s) }
network { drive = north suppresses other }
contract keeps: value_or(heading in 330 deg .. 340 deg, false) implies drive.velocity >= 100 mm/s
"""
    )
    found = margins(program, list(prove_contracts(program)), ProofOptions(), Deadline())
    margin = next(m for m in found if m.kind == "wrong")
    assert margin.proved <= 20 <= (margin.refuted or 0)
    assert margin.proved > 15
