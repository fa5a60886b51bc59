from __future__ import annotations

from dataclasses import replace

import pytest

from colony.compile import pipeline
from colony.compile.pipeline import compile_program
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.verify.equivalence.prove import prove
from colony.verify.equivalence.results import (
    EquivalenceProved,
    EquivalenceUndecided,
    Result,
    WrongActivity,
    WrongForm,
    WrongWinner,
)
from colony.verify.testing.agreement import EXECUTORS, disagreement
from tests.drawn.strategies import run_of_seed
from tests.networks import chain, ladder, random_program
from tests.verify.testing.bugs_in_passes import lists
from tests.verify.testing.seeded_bugs import BUGS, Bug

NOT_OF_THE_COMPILER = {"windows that include their end"}  # a mistake in what an operator of the executor does
PASSES = [bug for bug in BUGS if bug.network and bug.name not in NOT_OF_THE_COMPILER]


@pytest.mark.parametrize("seed", range(120))
def test_drawn_networks_are_proved(seed: int) -> None:
    program, _ = run_of_seed(seed, network=True)
    assert isinstance(prove(program, compile_program(program)), EquivalenceProved), seed


@pytest.mark.parametrize(
    ("program", "clients"),
    [(chain(300), 300), (ladder(300), 1), (random_program(300, 3), None), (random_program(60, 4), None)],
    ids=["chain", "ladder", "random 300", "random 60"],
)
def test_large_networks_are_proved(program: Program, clients: int | None) -> None:
    compilation = compile_program(program)
    result = prove(program, compilation)
    assert isinstance(result, EquivalenceProved)
    assert result.obligations == 2 * len(compilation.clients.actuators[0].clients)
    assert clients is None or result.obligations == 2 * clients
    assert (result.by_solver == 0) == (result.questions == 0)


def test_z3_decides_what_structure_does_not() -> None:
    program = random_program(60, 4)
    with_z3, without = (prove(program, compile_program(program), seconds=s) for s in (60, 0))
    assert isinstance(with_z3, EquivalenceProved)
    assert with_z3.by_solver > 0
    assert isinstance(without, EquivalenceUndecided), "and it is not claimed where z3 was not asked"


# --- what is found ---------------------------------------------------------------------------------


def first_found(bug: Bug, monkeypatch: pytest.MonkeyPatch) -> tuple[Program, Result]:
    bug.plant(monkeypatch)
    for seed in range(400):
        program, _ = run_of_seed(seed, network=True)
        result = prove(program, pipeline.compile_program(program))
        assert not isinstance(result, EquivalenceUndecided)
        if not isinstance(result, EquivalenceProved):
            return program, result
    raise AssertionError(f"{bug.name}: nothing found")


@pytest.mark.parametrize("bug", PASSES, ids=lambda bug: bug.name)
def test_every_mistake_of_a_pass_is_found(bug: Bug, monkeypatch: pytest.MonkeyPatch) -> None:
    program, found = first_found(bug, monkeypatch)
    assert not isinstance(found, EquivalenceProved)
    if isinstance(found, WrongWinner | WrongActivity) and not found.frame.recent:
        replayed(program, found)


def replayed(program: Program, found: WrongWinner | WrongActivity) -> None:
    """With the modules of the counterexample active in a first frame, reference and clients do differ.

    (What is observed of a module itself, executors read from the module, not from the list.)
    """
    if isinstance(found, WrongActivity) and found.name in {module.name for module in program.modules}:
        assert found.network == (found.name in found.frame.active)
        return
    readings = {f"p{m.name.removeprefix('m')}": m.name in found.frame.active for m in program.modules}
    clients = {name: EXECUTORS[name] for name in EXECUTORS if name.startswith("clients")}
    difference = disagreement(program, [Frame(0, readings)], clients)
    assert difference is not None
    if isinstance(found, WrongWinner):
        [by] = [d.by for d in difference.expected.decisions if d.actuator == found.actuator]
        assert by == found.network


@pytest.mark.parametrize(
    "name",
    [
        "children of inhibitors swapped",
        "chains associated to the left",
        "dominant though inhibited",
        "a shared module numbered at its first visit",
        "priorities in reverse",
        "exclusive guards that are not",
        "the lowest client lost",
        "activity of another wire observed",
    ],
)
def test_some_counterexamples_need_no_history(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    [bug] = [bug for bug in BUGS if bug.name == name]
    _, found = first_found(bug, monkeypatch)
    assert isinstance(found, WrongWinner | WrongActivity)
    assert not found.frame.recent


def test_a_counterexample_has_no_module_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    [bug] = [bug for bug in BUGS if bug.name == "priorities in reverse"]
    bug.plant(monkeypatch)
    program = chain(50)
    found = prove(program, pipeline.compile_program(program))
    assert isinstance(found, WrongWinner)
    assert len(found.frame.active) == 2
    assert {found.network, found.by_priority} == set(found.frame.active)


def test_priorities_that_are_not_n_to_1(monkeypatch: pytest.MonkeyPatch) -> None:
    shifted = lists(
        lambda a: replace(a, clients=tuple(replace(c, priority=c.priority + 1) for c in a.clients))
    )
    shifted(monkeypatch)
    program = chain(3)
    found = prove(program, pipeline.compile_program(program))
    assert isinstance(found, WrongForm)
    assert (found.found, found.expected) == ("the priorities 4, 3, 2", "3, 2, 1")
