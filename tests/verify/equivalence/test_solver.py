from __future__ import annotations

from random import Random

import pytest

from colony.verify.equivalence.circuit import FALSE, TRUE, Activity, Circuit
from colony.verify.equivalence.disagreement import evaluate, holds, minimal_inputs
from colony.verify.equivalence.solver import (
    CircuitSolver,
    Satisfied,
    Unsatisfiable,
    Unsettled,
    differ,
    obviously_unsatisfiable,
)


def deep(circuit: Circuit, names: list[str], seed: int) -> int:
    """The parity of some modules, joined in some order: nothing but a solver sees that two are equal."""
    random = Random(seed)
    order = random.sample(names, len(names))
    parity = FALSE
    for name in order:
        parity = circuit.same(parity, circuit.input(Activity(name))) ^ 1
    return parity


def test_equal_formulas_are_shown_equal_and_others_not() -> None:
    circuit = Circuit()
    names = [f"m{i}" for i in range(12)]
    one, other = deep(circuit, names, 1), deep(circuit, names, 2)
    assert one != other
    solver = CircuitSolver(circuit, 60_000)
    assert solver.decide(differ(one, other)) == Unsatisfiable()
    answer = solver.decide(differ(one, other ^ 1))
    assert isinstance(answer, Satisfied)
    values = evaluate(circuit, answer.inputs)
    assert values(one) != values(other ^ 1)
    assert solver.question_count > 0


def test_what_is_not_looked_at_is_not_taken_for_shown() -> None:
    circuit = Circuit()
    names = [f"m{i}" for i in range(12)]
    one, other = deep(circuit, names, 1), deep(circuit, names, 2)
    solver = CircuitSolver(circuit, 60_000)
    assert not solver.refutes(differ(one, other), near_limits=(3,))
    assert solver.refutes(differ(one, other))


def test_many_questions_are_one_question() -> None:
    circuit = Circuit()
    a, b, c = (circuit.input(Activity(name)) for name in "abc")
    both = circuit.both(a, circuit.either(b, c))
    solver = CircuitSolver(circuit, 60_000)
    true = [[(both,), (a ^ 1,)], [(both,), (b ^ 1,), (c ^ 1,)]]
    assert solver.refutes_each(true * 150)
    assert solver.question_count == 3
    assert not solver.refutes_each([*true, [(both,), (b ^ 1,)]])


def test_without_time_nothing_is_asked_and_nothing_claimed() -> None:
    circuit = Circuit()
    names = [f"m{i}" for i in range(6)]
    one, other = deep(circuit, names, 1), deep(circuit, names, 2)
    solver = CircuitSolver(circuit, 0)
    assert solver.decide(differ(one, other)) is Unsettled.GAVE_UP
    assert not solver.refutes(differ(one, other))
    assert not solver.refutes_each([differ(one, other)])
    assert solver.question_count == 0


@pytest.mark.parametrize(
    ("clauses", "expected"),
    [
        ([(FALSE,)], True),
        ([(4,), (5,)], True),
        ([(4,), (6,), (5, 7)], True),
        ([(4,), (5, 6)], False),
        ([(TRUE,), (4, 5)], False),
        ([], False),
    ],
)
def test_what_is_obvious(clauses: list[tuple[int, ...]], expected: bool) -> None:
    assert obviously_unsatisfiable(clauses) is expected


def test_a_solution_is_made_as_small_as_it_can_be() -> None:
    circuit = Circuit()
    literals = [circuit.input(Activity(f"m{i}")) for i in range(40)]
    clauses = [(literals[3],), (literals[7], literals[30]), (literals[9] ^ 1, literals[20])]
    everything = frozenset(literal >> 1 for literal in literals)
    few = minimal_inputs(circuit, everything, lambda values: holds(clauses, values))
    assert len(few) == 2
    assert literals[3] >> 1 in few
