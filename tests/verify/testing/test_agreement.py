"""All executors of a program do the same, in every frame, bit for bit."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given

from colony.compile.pipeline import Compilation
from colony.ir.frame import Decision, Executor, Frame, Outcome
from colony.ir.program import Program
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import EXECUTORS, client_disagreement, disagreement
from tests.drawn.strategies import Run, network_runs, runs
from tests.programs import MS, program
from tests.verify.testing.bugs_in_passes import after


@given(network_runs())
def test_executors_and_clients_alone_agree_on_networks(run: Run) -> None:
    found = disagreement(*run) or client_disagreement(*run)
    assert found is None, str(found)


@given(runs())
def test_executors_and_clients_alone_agree_on_programs(run: Run) -> None:
    found = disagreement(*run) or client_disagreement(*run)
    assert found is None, str(found)


# --- what counts as a difference -----------------------------------------------------------------

TEXT = "module m { when a do out(v = 1) }\nnetwork { out = m }"
TRACE = tuple(Frame(50 * MS * k, {"a": k > 0}) for k in range(3))


class Tampering:
    """The reference, with one outcome changed."""

    def __init__(self, of: Program, at: int, outcome: Outcome | Exception) -> None:
        self.reference, self.left, self.outcome = Interpreter(of), at, outcome

    def step(self, frame: Frame) -> Outcome:
        self.left -= 1
        if self.left >= 0:
            return self.reference.step(frame)
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome


def tampered(outcome: Outcome | Exception, at: int = 1) -> str:
    """What is said of an executor that gives this outcome in frame `at`."""
    of = program(TEXT)

    def make(compilation: Compilation) -> Executor:
        return Tampering(compilation.program, at, outcome)

    return str(disagreement(of, TRACE, {"tampered": make}))


BASE = Decision("base", None, (0.0, 0.0))
GOOD = Outcome((Decision("out", "m", (1.0,)), BASE))


def test_the_same_is_no_difference() -> None:
    assert tampered(GOOD, at=2) == "None"


@pytest.mark.parametrize(
    "outcome",
    [
        Outcome((Decision("out", "m", (1,)), BASE)),  # an int is no float
        Outcome((Decision("out", "m", (True,)), BASE)),
        Outcome((Decision("out", "m", (math.nan,)), BASE)),
        Outcome((Decision("out", "m", (1.0,)), Decision("base", None, (0.0, -0.0)))),
        Outcome((Decision("out", None, None), BASE)),
        Outcome(GOOD.decisions, (), ("contract",)),
    ],
)
def test_differences(outcome: Outcome) -> None:
    said = tampered(outcome)
    assert said.startswith("tampered: differs from the reference in frame 1\n")
    assert "frame 1: t = 50000000 ns, {'a': True}" in said
    assert "frame 2" not in said


def test_what_is_raised_is_a_difference() -> None:
    assert "raised:   ValueError: no" in tampered(ValueError("no"))


def test_nan_is_nan() -> None:
    of = program("network { out = m }\nmodule m { when true do out(v = 1) }\ncontract k: 0 / x != 0 / x")
    assert disagreement(of, (Frame(0, {"x": 0.0}), Frame(1, {"x": 1.0}))) is None


def test_executors_of_the_compiled_form_are_all_there() -> None:
    assert [*EXECUTORS] == ["clients by priority", "clients by exclusive guards", "generated Python"]


def test_clients_alone_that_are_both_active_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    of = program(
        "module m { when a do out(v = 1) } module n { when true do out(v = 2) }\n"
        "network { out = m suppresses n }"
    )
    after("simplify", _never_exclusive)(monkeypatch)
    found = client_disagreement(of, TRACE)
    assert isinstance(found.found, Outcome)
    assert found.found.decisions[0].by == "m and n"


def _never_exclusive(clients: object) -> object:
    from colony.compile.guards import ClientList

    assert isinstance(clients, ClientList)
    actuators = tuple(
        replace(a, clients=tuple(replace(c, exclusive=c.guard) for c in a.clients)) for a in clients.actuators
    )
    return replace(clients, actuators=actuators)
