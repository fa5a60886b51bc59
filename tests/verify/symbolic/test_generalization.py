"""What is proved of a generalize system holds of floats; and every run in floats is a run of it."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import pytest
import z3

from colony.dsl.load import load_file
from colony.ir.program import Program
from colony.ir.types import Value
from colony.verify.reference.interpreter import Interpreter
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.generalization import generalize
from colony.verify.symbolic.logic import real
from colony.verify.symbolic.system import ExtendedReal, Inexact, System, Term
from colony.verify.symbolic.unrolling import Unrolling
from tests.drawn.strategies import run_of_seed
from tests.paths import BEHAVIORS as SHIPPED
from tests.sampling import long
from tests.verify.symbolic.programs import broken, claim_of, program

BEHAVIORS = {path.stem: path for path in SHIPPED}

OF_REALS = [
    "fresh(x) and x in 1 mm .. 2 mm implies (x + 0.1 mm) + 0.1 mm == x + 0.2 mm",
    "a - x + x == a or not (fresh(a) and fresh(x))",
    "fresh(x) implies x / 3 * 3 == x",
]


@pytest.mark.parametrize("text", OF_REALS)
def test_what_holds_of_reals_only_is_not_proved(text: str) -> None:
    system = encode(program(f"contract c: {text}"))
    assert claim_of(system, "c").inexact
    general = generalize(system)
    assert not claim_of(general, "c").inexact
    assert broken(general, "c").check() == z3.sat


OF_FLOATS = [
    "fresh(x) implies x * 0.1 <= 100 mm",
    "fresh(x) implies x * 0.1 >= 0 mm",
    "fresh(x) implies x + 0.1 mm == x + 0.1 mm",
    "fresh(x) implies x * x >= 0 mm * 1 mm",
    "fresh(x) implies min(x * 0.3, 50 mm) <= 50 mm",
    "fresh(a) implies mod(a / 1 mm, 7) in 0 .. 7 or not (a - a == 0 mm)",
    "fresh(p) implies elapsed(p) >= 0 s",
    "fresh(x) implies sqrt(x / 1 mm) <= 32",
    "fresh(a) implies angle_difference(a / 1 mm * 1 deg, 0 deg) <= 180 deg or not (a - a == 0 mm)",
]


@pytest.mark.parametrize("text", OF_FLOATS)
def test_what_rounding_cannot_break_is_proved(text: str) -> None:
    general = generalize(encode(program(f"contract c: {text}")))
    assert not claim_of(general, "c").inexact
    assert broken(general, "c").check() == z3.unsat


def test_a_number_beyond_all_floats_is_infinite() -> None:
    text = "contract c: fresh(a) and abs(a) < 1e308 mm implies (a * 10) - (a * 10) == 0 mm"
    system = encode(program(text))
    assert broken(system, "c").check() == z3.unsat
    assert broken(generalize(system), "c").check() == z3.sat


@pytest.mark.parametrize(("most", "answer"), [(2**53 - 1, z3.unsat), (2**53, z3.sat)])
def test_sums_of_whole_numbers_are_exact_where_small(most: int, answer: z3.CheckSatResult) -> None:
    text = f"state n = 0  next n = n + 1\ncontract c: n in 0 .. {most} implies n + 1 > n"
    assert broken(generalize(encode(program(text))), "c").check() == answer


@pytest.mark.parametrize("close", [False, True])
def test_frames_with_nan_are_frames_of_it(close: bool) -> None:
    """The value of `y` is 0 where it is NaN, and within 5 .. 10 elsewhere."""
    text = """let y = if p then mod(x / 1 mm, 0) else clamp(x / 1 mm, 5, 10)
    contract c: fresh(x) and fresh(p) and p implies y + 0.1 > 6 or (x + 0.1 mm) + 0.1 mm == x + 0.2 mm"""
    assert broken(generalize(encode(program(text)), close=close), "c").check() == z3.sat


@pytest.mark.parametrize("name", ["rome", "wander", "herbert", long("hallway")])
def test_shipped_contracts_hold_bit_for_bit(name: str) -> None:
    general = generalize(encode(load_file(BEHAVIORS[name])))
    for contract in ("brakes_in_time", "never_rams", "stands_blind"):
        assert not claim_of(general, contract).inexact
        assert broken(general, contract).check() == z3.unsat


# --- every run in floats is a run of it ----------------------------------------------------------


_UNEXPLAINED = pytest.mark.xfail(strict=True, reason="what a holding actuator was sent has no model")


@pytest.mark.parametrize(
    "seeds",
    [range(100, 104), range(104, 106), pytest.param(range(125, 126), marks=_UNEXPLAINED), range(110, 116)],
    ids=lambda seeds: str(seeds.start),
)
def test_runs_in_floats_are_runs_of_it(seeds: range) -> None:
    for seed in seeds:
        drawn, trace = run_of_seed(seed, max_frames=3)
        general = generalize(encode(drawn))
        solver = z3.Solver()
        solver.set("timeout", 10_000)
        unrolling = Unrolling(general)
        solver.add(*unrolling.initial())
        interpreter = Interpreter(drawn)
        for i, frame in enumerate(trace):
            interpreter.step(frame)
            solver.add(*unrolling.step(i))
            solver.add(*(unrolling.at(i, x) for x in _facts(drawn, general, interpreter)))
        assert solver.check() == z3.sat, f"seed {seed}"


def _facts(drawn: Program, system: System, interpreter: Interpreter) -> Iterator[z3.BoolRef]:
    """What a frame was given and what the interpreter made of it, to the last bit."""
    frame_values = interpreter._moment
    yield system.now == frame_values.t_ns - frame_values.first_ns
    yield system.restarted == frame_values.restarted
    for sensor in drawn.robot.sensors:
        terms = system.sensors[sensor.name]
        there = sensor.name in frame_values.fresh
        yield terms.present == there
        if there:
            value = frame_values.sensors[sensor.name]
            given = terms.elements if isinstance(value, tuple) else terms.elements[0]
            yield from _equal(given, value)
    for name, answer in system.python.items():
        yield answer.answers == (name in frame_values.commands)
    for name, (missing, term) in system.derived.items():
        yield missing == (name not in frame_values.derived)
        if name in frame_values.derived:
            yield from _equal(term, frame_values.derived[name])
    for name, active in system.active.items():
        yield active == (frame_values.outputs[name] is not None)
        if name in frame_values.commands:
            yield from _equal(system.modules[name].command, frame_values.commands[name])
    for name, actuator in system.actuators.items():
        yield actuator.commanded == (name in frame_values.commanded)
        for i, sent in enumerate(actuator.sent):
            if (name, i) in frame_values.sent:
                yield from _equal(sent, frame_values.sent[name, i])


def _equal(term: Term, value: Value) -> Iterator[z3.BoolRef]:
    if isinstance(term, tuple):
        assert isinstance(value, tuple)
        for x, v in zip(term, value, strict=True):
            yield from _equal(x, v)
        return
    assert not isinstance(value, tuple)
    if not isinstance(term, ExtendedReal):
        yield term == bool(value)
    elif value != value:
        yield term.nan
    elif value - value != 0:
        yield z3.And(z3.Not(term.nan), term.infinite, term.value > 0 if value > 0 else term.value < 0)
    else:
        yield z3.And(z3.Not(term.nan), z3.Not(term.infinite), term.value == real(Fraction(value)))


def test_modules_in_python_stay_a_reason() -> None:
    text = 'module c from python "tests.verify.scripted_modules:Scripted" { reads x  commands drive }'
    text += " network { drive = c }  contract c1: drive.v + 0 mm/s <= 401 mm/s"
    general = generalize(encode(program(text)))
    assert {r.kind for r in claim_of(general, "c1").inexact} == {Inexact.PYTHON}
