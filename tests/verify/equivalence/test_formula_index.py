from __future__ import annotations

from itertools import permutations

from colony.verify.equivalence.circuit import FALSE, Activity, Circuit, HeldInput
from colony.verify.equivalence.formula_index import FormulaIndex
from colony.verify.equivalence.solver import CircuitSolver


def joined(circuit: Circuit, literals: tuple[int, ...]) -> int:
    result = literals[0]
    for literal in literals[1:]:
        result = circuit.both(result, literal)
    return result


def test_a_formula_is_found_again_in_whatever_order_it_is_joined() -> None:
    circuit = Circuit()
    parts = tuple(circuit.input(Activity(name)) ^ (name > "c") for name in "abcdef")
    old = joined(circuit, parts)
    index = FormulaIndex(circuit, CircuitSolver(circuit, 60_000))
    for order in permutations(parts):
        assert index.find(joined(circuit, order)) == old
        assert index.find(joined(circuit, order) ^ 1) == old ^ 1
    assert index.find(joined(circuit, (*parts[:-1], parts[-1] ^ 1))) != old


def test_a_formula_that_is_equal_for_other_reasons_is_found_too() -> None:
    circuit = Circuit()
    a, b, c = (circuit.input(Activity(name)) for name in "abc")
    old = circuit.either(circuit.both(a, b), circuit.both(a, c))
    index = FormulaIndex(circuit, CircuitSolver(circuit, 60_000))
    new = circuit.both(a, circuit.either(b, c))
    assert new != old
    assert index.find(new) == old
    assert index.merged == 1


def test_formulas_that_only_look_alike_are_told_apart() -> None:
    """They differ in one of 2 ** 16 valuations, which none of the random ones is."""
    circuit = Circuit()
    inputs = tuple(circuit.input(Activity(f"m{i}")) for i in range(16))
    rare_inputs, a = joined(circuit, inputs), circuit.input(Activity("a"))
    old = circuit.both(a, circuit.input(Activity("b")))
    index = FormulaIndex(circuit, CircuitSolver(circuit, 60_000))
    new = circuit.both(old, rare_inputs ^ 1)
    assert index.find(new) == new


def test_a_history_is_shared_by_equal_conditions_with_equal_windows_alone() -> None:
    circuit = Circuit()
    a, b, c = (circuit.input(Activity(name)) for name in "abc")
    old = circuit.either(circuit.both(a, b), circuit.both(a, c))
    history = circuit.input(HeldInput(old, 100))
    index = FormulaIndex(circuit, CircuitSolver(circuit, 60_000))
    same = circuit.both(a, circuit.either(b, c))
    assert index.recently(same, 100) == circuit.either(same, history)
    assert index.recently(same, 101) != circuit.either(same, history)
    assert index.recently(a, 100) != circuit.either(a, history)
    assert index.recently(same, 0) == same
    assert index.recently(FALSE, 100) == FALSE


def test_what_is_never_true_has_no_history() -> None:
    circuit = Circuit()
    a, b = (circuit.input(Activity(name)) for name in "ab")
    never = circuit.both(circuit.both(a, b), circuit.both(a ^ 1, circuit.input(Activity("c"))))
    index = FormulaIndex(circuit, CircuitSolver(circuit, 60_000))
    assert index.first_equal([never, a, b, circuit.both(b, a), circuit.both(a, b)]) == [None, 1, 2, 3, 3]
