"""A model of an unrolling is frames that the interpreter runs, to the same end."""

from __future__ import annotations

import math

import pytest
import z3

from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.system import System
from colony.verify.symbolic.unrolling import Unrolling, cone, snapshots, value_in
from tests.verify.symbolic.programs import claim_of, program

BROKEN = {
    "not fresh(x) or x < 999 mm": 1,
    "not (fresh(p) and recently(p, 2 s)) or p": 2,
    "not every(1 s) or now < 3 s": 4,
    "not (fresh(x) and previous(x, 3 mm) > 7 mm and x < 2 mm)": 2,
    "not (fresh(s) and fresh(p)) or min(s) < 900 mm or p": 1,
    "not fresh(a) or a < 5 mm or a - a == 0 mm": 1,
    "not (fresh(x) and not fresh(a))": 1,
    "not (fresh(p) and elapsed(p) >= 1.5 s and q)": 2,
    "fresh(s) and fresh(p) implies count(captured(s[k] > 500 mm, p) for k in 0 .. 4) != 3": 1,
    "x <= 1000 mm": 1,
    "not previous(fresh(x), false) or x <= 1000 mm": 2,
}


def witness(text: str, count: int) -> tuple[System, Unrolling, z3.ModelRef, tuple[Snapshot, ...]]:
    system = encode(program(f"contract c: {text}"))
    claim = claim_of(system, "c")
    unrolling = Unrolling(system, cone(system, (claim.holds,)))
    solver = z3.Solver()
    solver.add(*unrolling.initial())
    for i in range(count - 1):
        solver.add(*unrolling.step(i), unrolling.at(i, claim.holds))
    solver.add(*unrolling.frame(count - 1))
    solver.add(z3.Not(unrolling.at(count - 1, claim.holds)))
    assert solver.check() == z3.sat
    return system, unrolling, solver.model(), snapshots(solver.model(), unrolling, count)


@pytest.mark.parametrize(("text", "count"), BROKEN.items())
def test_a_refutation_breaks_the_contract_in_the_interpreter(text: str, count: int) -> None:
    system, _, _, found = witness(text, count)
    interpreter = Interpreter(system.program)
    breaches = [interpreter.step_in_base_units(f.t_ns, f.readings).breaches for f in found]
    assert breaches == [()] * (count - 1) + [("c",)]


def test_times_rise_where_nothing_depends_on_them() -> None:
    _, _, _, found = witness("not (fresh(p) and previous(p, false) and not p)", 2)
    assert [f.t_ns for f in found] == [0, 50_000_000]


def test_sensors_on_which_nothing_depends_are_missing() -> None:
    _, _, _, (frame,) = witness("not fresh(x) or x < 999 mm", 1)
    assert frame.readings.keys() == {"x"}


def test_values_are_given() -> None:
    system, unrolling, model, found = witness("not (fresh(x) and previous(x, 3 mm) > 7 mm and x < 2 mm)", 2)
    (x,) = system.sensors["x"].elements
    assert value_in(model, unrolling, 0, x) == found[0].readings["x"]
    assert value_in(model, unrolling, 1, x) == found[1].readings["x"]


def test_infinities_come_out() -> None:
    _, _, _, (frame,) = witness("not fresh(a) or a < 5 mm or a - a == 0 mm", 1)
    assert frame.readings["a"] == math.inf
