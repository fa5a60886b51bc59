"""Elaboration of the typed program to its network: names become references, chains become nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from colony.compile.network import Inhibitor, ModuleLeaf, Network, NetworkNode, Suppressor
from colony.ir.expression import Expression, IsActive, subexpressions
from colony.ir.memory import window_cell
from colony.ir.program import Chain, Program, Use, Wiring


def elaborate(program: Program) -> Network:
    """Return the network that the program's wires describe.

    A chain `a op[w0] b op[w1] c` becomes the nodes of `a op[w0] (b op[w1] c)`. Wires that reach no actuator
    are in the network as well. Modules that no wire uses are not, unless contracts or tests read their
    activity.

    Raises:
        ValueError: a wiring uses a name that is neither a module nor a wire declared above it (the front
            end lets no such program through).
    """
    elaboration = _Elaboration(program)
    for wire in program.wires:
        node = elaboration.wiring(wire.wiring, wire.name, ())
        if wire.actuator is None:
            elaboration.wires[wire.name] = node
        else:
            elaboration.drivers[wire.actuator] = node
    observed = {name: elaboration.use(name) for name in _observed_names(program)}
    drivers = elaboration.drivers
    return Network(
        nodes=tuple(elaboration.nodes),
        outputs=tuple((a.name, drivers[a.name]) for a in program.robot.actuators if a.name in drivers),
        wires=tuple(elaboration.wires.items()),
        observed=tuple(observed.items()),
    )


class _Elaboration:
    """Mutable. Recursion over a wiring is safe, as it is only as deep as the nesting of parentheses."""

    def __init__(self, program: Program) -> None:
        self.modules = {module.name: module for module in program.modules}
        self.nodes: list[NetworkNode] = []
        self.leaves: dict[str, int] = {}
        self.wires: dict[str, int] = {}
        self.drivers: dict[str, int] = {}

    def wiring(self, wiring: Wiring, wire: str, path: tuple[int, ...]) -> int:
        match wiring:
            case Use(name=name):
                return self.use(name)
            case Chain():
                return self.chain(wiring, wire, path)
            case _:
                assert_never(wiring)

    def use(self, name: str) -> int:
        node = self.wires.get(name)
        if node is None:
            node = self.leaves.get(name)
        if node is None:
            if name not in self.modules:
                raise ValueError(f"`{name}` is neither a module nor a wire declared above")
            node = self.leaves[name] = self.add(ModuleLeaf(module=name, failsafe=self.modules[name].failsafe))
        return node

    def chain(self, chain: Chain, wire: str, path: tuple[int, ...]) -> int:
        node_type = Suppressor if chain.relation == "suppresses" else Inhibitor
        inputs = [self.wiring(operand, wire, (*path, i)) for i, operand in enumerate(chain.operands)]
        node = inputs.pop()
        for i in reversed(range(len(inputs))):
            window = window_cell(wire, (*path, i))
            node = self.add(
                node_type(
                    dominant=inputs[i], inferior=node, window_ns=chain.windows_ns[i], memory_name=window
                )
            )
        return node

    def add(self, node: NetworkNode) -> int:
        self.nodes.append(node)
        return len(self.nodes) - 1


def _observed_names(program: Program) -> list[str]:
    """Return the names that contracts and examples use in `is active`, each once, in order."""
    names = dict.fromkeys(
        node.name
        for root in _conditions(program)
        for node in subexpressions(root)
        if isinstance(node, IsActive)
    )
    return list(names)


def _conditions(program: Program) -> Iterator[Expression]:
    for contract in program.contracts:
        yield contract.expression
    for example in program.tests:
        for step in example.steps:
            yield from step.expectations
