"""The network of a program as a graph with one node per suppressor or inhibitor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, assert_never

from colony.ir.program import Chain, Program, Use, Wire, Wiring


@dataclass(frozen=True, slots=True, kw_only=True)
class WiringNode:
    """A suppressor or inhibitor.

    Attributes:
        name: Unique name; no module or wire can have it.
        path: Wire, indices of operands from the outermost chain inward, and index of the dominant operand.
        chain: Chain that contains it.
        dominant: Module or node whose output dominates.
        inferior: Module or node whose output is dominated.
    """

    name: str
    path: tuple[str, *tuple[int, ...]]
    chain: Chain
    dominant: str
    inferior: str

    @property
    def index(self) -> int:
        """Index of the dominant operand in the chain."""
        return int(self.path[-1])

    @property
    def relation(self) -> Literal["suppresses", "inhibits"]:
        """The effect of the dominant input on the inferior one."""
        return self.chain.relation

    @property
    def window_ns(self) -> int:
        """Time constant, 0 for none."""
        return self.chain.windows_ns[self.index]

    def wire(self, name: str, dominant: str, inferior: str) -> Wire:
        """Return a wire that consists of this node alone, with the given inputs."""
        operands = (Use(name=dominant), Use(name=inferior))
        wiring = replace(self.chain, operands=operands, windows_ns=(self.window_ns,))
        return Wire(name=name, span=self.chain.span, wiring=wiring)


@dataclass(frozen=True, slots=True, kw_only=True)
class WiringGraph:
    """The network of a program.

    Attributes:
        nodes: All nodes in topological order: each comes after its inputs.
        wires: Module or node at the output of each named wire.
        roots: Module or node that drives each wired actuator.
    """

    nodes: tuple[WiringNode, ...]
    wires: Mapping[str, str]
    roots: Mapping[str, str]


def wiring_graph(program: Program) -> WiringGraph:
    """Return the network of a program as a graph."""
    builder = _GraphBuilder()
    for wire in program.wires:
        output = builder.wiring(wire.wiring, (wire.name,))
        if wire.actuator is None:
            builder.wires[wire.name] = output
        else:
            builder.roots[wire.actuator] = output
    return WiringGraph(nodes=tuple(builder.nodes), wires=builder.wires, roots=builder.roots)


class _GraphBuilder:
    """Builds a graph from wirings. Mutable. Recursion is only as deep as the nesting of parentheses."""

    def __init__(self) -> None:
        self.nodes: list[WiringNode] = []
        self.wires: dict[str, str] = {}
        self.roots: dict[str, str] = {}

    def wiring(self, wiring: Wiring, path: tuple[str, *tuple[int, ...]]) -> str:
        """Add the nodes of a wiring; return the module or node at its output."""
        match wiring:
            case Use(name=name):
                return self.wires.get(name, name)
            case Chain(operands=operands):
                *dominant, inferior = (self.wiring(o, (*path, i)) for i, o in enumerate(operands))
                for i in reversed(range(len(dominant))):
                    inferior = self._joint(wiring, (*path, i), dominant[i], inferior)
                return inferior
            case _:
                assert_never(wiring)

    def _joint(self, chain: Chain, path: tuple[str, *tuple[int, ...]], dominant: str, inferior: str) -> str:
        """Add a node and return its name; `a op[w0] b op[w1] c` is `a op[w0] (b op[w1] c)`."""
        name = f"node {len(self.nodes)}"
        self.nodes.append(WiringNode(name=name, path=path, chain=chain, dominant=dominant, inferior=inferior))
        return name
