"""What a system is made of: names, memory that is shared, bounds of memory, invariants, reasons."""

from __future__ import annotations

from fractions import Fraction

import pytest
import z3

from colony.dsl.load import load_file
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.system import ExtendedReal, Inexact, NumberBounds, System
from colony.verify.symbolic.unrolling import Unrolling
from tests.drawn.strategies import run_of_seed
from tests.paths import ROOT
from tests.sampling import thorough
from tests.verify.symbolic.programs import broken, claim_of, program

BEHAVIORS = ROOT / "behaviors"

TWO = """
module m { when recently(p, 1 s)  do drive(v = 100 mm/s) }
module c from python "tests.verify.scripted_modules:Scripted" { reads x  commands drive }
network { drive = m suppresses[2 s] c }
"""


def names(system: System) -> list[str]:
    return [c.name for c in system.cells]


def number(system: System, name: str) -> ExtendedReal:
    value = system.states[name]
    assert isinstance(value, ExtendedReal)
    return value


# --- memory --------------------------------------------------------------------------------------


def test_a_contract_shares_the_memory_of_a_time_constant() -> None:
    text = "module m { when p  do drive(v = 1 mm/s) }  module n { when true  do drive(v = 2 mm/s) }"
    text += " network { drive = m suppresses[2 s] n }"
    alone = encode(program(text))
    both = encode(program(text + " contract c: recently(m is active, 1 s)"))
    assert len(both.cells) == len(alone.cells)
    contract = "contract quiet: recently(m is active, 2 s) and not (m is active) implies drive is idle"
    assert broken(encode(program(text + contract)), "quiet").check() == z3.unsat


@pytest.mark.parametrize(
    ("text", "kind", "cells"),
    [
        ("let one = recently(p, 1 s)  let other = recently(p, 1 s) and x > 3 mm", "recently.ever", 2),
        ("let v = rising(p) or falling(p) or previous(p, false) or changed(p)", "last", 1),
        ("let v = count(every(100 ms) for k in 0 .. 4)", "every", 1),
    ],
    ids=["in other frames", "of several functions", "of calls that end alike"],
)
def test_memory_is_shared_by_what_remembers_the_same_in_the_same_frames(
    text: str, kind: str, cells: int
) -> None:
    found = [name for name in names(encode(program(text))) if kind in name and name != "last"]
    assert len(found) == cells


# --- bounds of memory ----------------------------------------------------------------------------


def test_what_is_clamped_before_it_is_kept_stays_within() -> None:
    system = encode(program("state v : mm = 10 mm  next v = clamp(0.5 * v + x, 5 mm, 300 mm)"))
    assert number(system, "v").bounds == NumberBounds(Fraction(5), Fraction(300))
    assert "v.infinite" not in names(system)
    assert "v.nan" not in names(system)


def test_a_counter_is_a_whole_number() -> None:
    system = encode(program("state n : number = 0  next n = if n >= 3 then 0 else n + 1"))
    assert number(system, "n").value.arg(0).sort() == z3.IntSort()


def test_a_whole_number_that_a_minimum_with_a_fraction_keeps_is_whole() -> None:
    system = encode(program("state n = -1  next n = min(x / 1 mm, n)\ncontract c: n == -1"))
    [cell] = (c for c in system.cells if c.name == "n")
    assert cell.next.sort() == cell.old.sort() == z3.IntSort()


def test_a_state_can_become_nan_and_infinite() -> None:
    system = encode(program("state v : number = 1  next v = if p then sqrt(-1) else v / (x / 1 mm)"))
    assert {"v.nan", "v.infinite"} <= set(names(system))


def test_a_state_that_is_never_written_keeps_its_value() -> None:
    system = encode(program("state v : mm = 7 mm  contract c: v == 7 mm"))
    assert broken(system, "c").check() == z3.unsat


PROGRAMS = {
    "hallway": lambda: load_file(BEHAVIORS / "hallway.colony"),
    "teleop": lambda: load_file(BEHAVIORS / "teleop.colony"),
    **{f"seed {seed}": lambda seed=seed: run_of_seed(seed)[0] for seed in range(6)},
}


@pytest.mark.parametrize("name", [thorough(name) if name == "hallway" else name for name in PROGRAMS])
def test_invariants_hold_at_first_and_are_preserved(name: str) -> None:
    unrolling = Unrolling(encode(PROGRAMS[name]()))
    solver = z3.Solver()
    solver.set("timeout", 10_000)
    solver.add(*unrolling.initial())
    assert solver.check(z3.Not(z3.And(*unrolling.invariants(0), True))) == z3.unsat
    solver = z3.Solver()
    solver.set("timeout", 10_000)
    solver.add(*unrolling.invariants(0), *unrolling.step(0))
    assert solver.check() == z3.sat
    for invariant in unrolling.invariants(1):  # one by one: together they are more than z3 does in time
        solver = z3.Solver()
        solver.set("timeout", 60_000)
        solver.add(*unrolling.invariants(0), *unrolling.step(0))
        assert solver.check(z3.Not(invariant)) == z3.unsat, invariant


# --- what follows ---------------------------------------------------------------------------------


LIMITED = """
module m { when true  do drive(v = x * 2 / 1 s) }
network { drive = m }
limit drive.v <= 100 mm/s when p
contract slow: fresh(p) and p implies drive.v <= 100 mm/s
contract blind: not fresh(p) implies drive.v <= 100 mm/s
contract range: drive.v in -600 mm/s .. 500 mm/s
contract slower: fresh(p) and p implies drive.v < 100 mm/s
contract commanded: drive is commanded
"""


@pytest.mark.parametrize(("name", "answer"), [("slow", z3.unsat), ("blind", z3.unsat), ("range", z3.unsat)])
def test_limits_and_ranges_hold(name: str, answer: z3.CheckSatResult) -> None:
    assert broken(encode(program(LIMITED)), name).check() == answer


@pytest.mark.parametrize("name", ["slower", "commanded"])
def test_what_can_be_broken_is_satisfiable(name: str) -> None:
    assert broken(encode(program(LIMITED)), name, initial=True).check() == z3.sat


def test_a_field_on_hold_is_what_was_sent_last_and_unknown_before() -> None:
    text = """module m { when p  do light(level = 3) }
network { light = m }
contract ever: light.level == 3
contract never: not (light.level == 3)
contract now: light is commanded implies light.level == 3
contract after: previous(light is commanded, false) implies light.level == 3
"""
    system = encode(program(text))
    assert broken(system, "ever", initial=True).check() == z3.sat
    assert broken(system, "never", initial=True).check() == z3.sat
    assert broken(system, "now").check() == z3.unsat
    assert broken(system, "after", frames=3, initial=True).check() == z3.unsat


def test_precise_products_follow_from_their_factors() -> None:
    text = "contract square: fresh(x) implies x * x + 1 mm * 1 mm >= 2 * x * 1 mm"
    assert broken(encode(program(text)), "square").check() == z3.sat
    assert broken(encode(program(text), precise=True), "square").check() == z3.unsat


def test_reasons_name_the_place_and_come_through_memory() -> None:
    text = "let y = x * 0.1\nlet z = previous(y, 0 mm)\ncontract c: z >= 1 mm\ncontract d: x >= 1 mm"
    system = encode(program(text))
    (reason,) = claim_of(system, "c").inexact
    assert reason.kind is Inexact.ROUNDING
    assert reason.span.text == "x * 0.1"
    assert not claim_of(system, "d").inexact


def test_modules_in_python_are_a_reason() -> None:
    system = encode(program(TWO + "contract c: drive.v <= 400 mm/s"))
    assert {r.kind for r in claim_of(system, "c").inexact} == {Inexact.PYTHON}
    assert broken(system, "c").check() == z3.sat


def test_sums_of_small_whole_numbers_are_exact() -> None:
    system = encode(program("contract c: count(s < 5 mm) + 2 * count(s > 7 mm) - 1 <= 9"))
    assert not claim_of(system, "c").inexact
