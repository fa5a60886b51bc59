"""Values of a circuit's literals under given values of its inputs, computed one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from colony.verify.equivalence.circuit import Circuit, Input


def valued(circuit: Circuit, inputs: Mapping[Input, bool]) -> Callable[[int], bool]:
    """The value of any literal; an input that is not given must not matter."""
    by_node = {literal >> 1: inputs[of] for of, literal in circuit.inputs.items() if of in inputs}
    known: dict[int, bool] = {0: False}
    for node in range(1, len(circuit)):
        if circuit.is_input(node):
            known[node] = by_node.get(node, False)
            continue
        left, right = circuit.left[node], circuit.right[node]
        known[node] = (known[left >> 1] != bool(left & 1)) and (known[right >> 1] != bool(right & 1))
    return lambda literal: known[literal >> 1] != bool(literal & 1)
