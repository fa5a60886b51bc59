"""Translation of a solution from z3 into a readable counterexample."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

from colony.verify.equivalence.circuit import Activity, Circuit, HeldInput
from colony.verify.equivalence.network import NetworkFormulas
from colony.verify.equivalence.results import Activation, Counterexample, EquivalenceUndecided, Recent
from colony.verify.equivalence.solver import CircuitSolver, Clause, Satisfied, Unsatisfiable

Values = Callable[[int], bool]
"""The value of a literal."""


def evaluate(circuit: Circuit, inputs: frozenset[int]) -> Values:
    """Return the values of all literals if these inputs are true and all others false."""
    values = bytearray(len(circuit))
    for node in range(1, len(circuit)):
        if circuit.is_input(node):
            values[node] = node in inputs
        else:
            left, right = circuit.left[node], circuit.right[node]
            values[node] = (values[left >> 1] ^ (left & 1)) & (values[right >> 1] ^ (right & 1))
    return lambda literal: bool(values[literal >> 1] ^ (literal & 1))


def minimal_inputs(
    circuit: Circuit, inputs: frozenset[int], condition: Callable[[Values], bool]
) -> frozenset[int]:
    """Return a minimal subset of the inputs for which `condition` holds: none can be left out."""
    kept = sorted(inputs)
    size = len(kept)
    while size:
        for start in reversed(range(0, len(kept), size)):
            fewer = kept[:start] + kept[start + size :]
            if condition(evaluate(circuit, frozenset(fewer))):
                kept = fewer
        size //= 2
    return frozenset(kept)


def decide_clauses(
    solver: CircuitSolver,
    clauses: Sequence[Clause],
    undecided: EquivalenceUndecided,
    describe: Callable[[frozenset[int]], Counterexample],
) -> Counterexample | EquivalenceUndecided | None:
    """Return `describe` of a minimal solution of the clauses; None if they have no solution."""
    answer = solver.decide(clauses)
    match answer:
        case Unsatisfiable():
            return None
        case Satisfied(inputs=inputs):
            return describe(minimal_inputs(solver.circuit, inputs, lambda values: holds(clauses, values)))
        case _:
            return undecided


def nested_histories(circuit: Circuit) -> Iterator[Clause]:
    """Yield clauses true in every frame: active within a window implies active within a longer one."""
    by_operand: dict[int, list[tuple[int, int]]] = {}
    for input_, literal in circuit.inputs.items():
        if isinstance(input_, HeldInput):
            by_operand.setdefault(input_.operand, []).append((input_.window_ns, literal))
    for histories in by_operand.values():
        histories.sort()
        for (_, shorter), (_, longer) in pairwise(histories):
            yield (shorter ^ 1, longer)


def holds(clauses: Sequence[Clause], values: Values) -> bool:
    """Return True if all clauses are true."""
    return all(any(values(literal) for literal in clause) for clause in clauses)


def frame_of(circuit: Circuit, inputs: frozenset[int], source: NetworkFormulas) -> Activation:
    """Return the true inputs as a frame, with the names of the program."""
    active = [
        input_.module
        for input_, literal in circuit.inputs.items()
        if isinstance(input_, Activity) and literal >> 1 in inputs
    ]
    ended: dict[int, list[int]] = {}
    running: dict[int, list[int]] = {}
    for input_, literal in circuit.inputs.items():
        if isinstance(input_, HeldInput):
            windows_by_operand = running if literal >> 1 in inputs else ended
            windows_by_operand.setdefault(input_.operand, []).append(input_.window_ns)
    names = _Names(source)
    recent = [
        Recent(name=names.name_of(operand), min_age_ns=max(ended.get(operand, [0])), max_age_ns=min(windows))
        for operand, windows in running.items()
    ]
    return Activation(active=tuple(active), recent=tuple(recent))


class _Names:
    """The names of a network's activities."""

    def __init__(self, source: NetworkFormulas) -> None:
        self._source = source
        self._by_node = {node: name for name, node in reversed(list(source.names.items()))}
        self._node = {literal: index for index, literal in reversed(list(enumerate(source.active)))}
        self._node |= {source.active[index]: index for index in self._by_node}

    def name_of(self, literal: int) -> str:
        index = self._node.get(literal)
        return "a condition of the compiled clients" if index is None else self._text(index, 3)

    def _text(self, index: int, depth: int) -> str:
        name = self._by_node.get(index)
        node = self._source.nodes[index]
        if name is not None or isinstance(node, str):
            return str(name or node)
        if depth == 0:
            return "..."
        relation = "suppresses" if node.suppresses else "inhibits"
        return f"({self._text(node.dominant, depth - 1)} {relation} {self._text(node.inferior, depth - 1)})"
