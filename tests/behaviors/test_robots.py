"""Behaviors for any robot on each robot that comes with colony: checked, tested, proved, in agreement.

`tests/behaviors/on` has what the limits of one robot make of a behavior: tests of the very speeds and turns.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import check_file, load_file
from colony.execute.executor import ProgramExecutor
from colony.ir.program import Program
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import OverReals, Proved
from colony.verify.lints.linting import lint
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.examples import failures_as_diagnostics, run_examples
from tests.behaviors.test_behaviors import random_frames
from tests.paths import ROBOTS, ROOT

PORTABLE = ("wander", "teleop", "follow_wall")
SEEING = ("amr", "omni", "pioneer", "rome", "turtlebot")
"""The robots that see far enough for those."""
SLOW = ("turtlebot",)
"""The robots that are slower than behaviors for any robot want to drive."""
PAIRS = [*product(PORTABLE, SEEING), *product(("bounce",), ("create2", "rome"))]
ON_ONE_ROBOT = sorted((Path(__file__).parent / "on").glob("*.colony"))

each_pair = pytest.mark.parametrize(("behavior", "robot"), PAIRS)


def program_of(behavior: str, robot: str) -> Program:
    return load_file(ROOT / "behaviors" / f"{behavior}.colony", robot=robot)


def test_there_are_robots() -> None:
    assert {robot for _, robot in PAIRS} == {path.stem for path in ROBOTS}


@each_pair
def test_it_checks_without_a_word(behavior: str, robot: str) -> None:
    assert check_file(ROOT / "behaviors" / f"{behavior}.colony", robot=robot).diagnostics == ()


@each_pair
def test_its_examples_hold(behavior: str, robot: str) -> None:
    results = run_examples(program_of(behavior, robot))
    assert len(results) >= 4
    assert failures_as_diagnostics(results) == ()


@pytest.mark.long
@each_pair
def test_its_contracts_are_proved_and_nothing_is_said_of_its_modules(behavior: str, robot: str) -> None:
    program = program_of(behavior, robot)
    assert [r.contract.name for r in prove_contracts(program) if not isinstance(r, Proved | OverReals)] == []
    expected = {"V025"} if robot in SLOW else set()  # their speeds are clamped to its range
    assert {finding.diagnostic.code for finding in lint(program)} <= expected


@each_pair
def test_its_contracts_hold_and_its_clients_agree_on_random_frames(behavior: str, robot: str) -> None:
    program = program_of(behavior, robot)
    reference = Interpreter(program)
    executor = ProgramExecutor(lower(program, compile_program(program).clients))
    for frame in random_frames(program, seed=414, count=60):
        outcome = reference.step(frame)
        assert outcome.breaches == ()
        assert executor.step(frame) == outcome


@pytest.mark.parametrize("path", ON_ONE_ROBOT, ids=lambda path: path.stem)
def test_what_one_robot_makes_of_it(path: Path) -> None:
    checked = check_file(path)
    assert checked.diagnostics == ()
    assert checked.program is not None
    results = run_examples(checked.program)
    assert results
    assert failures_as_diagnostics(results) == ()
