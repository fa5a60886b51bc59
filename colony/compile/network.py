"""The network as wired: modules, suppressor nodes and inhibitor nodes, as one flat table.

A network is a directed acyclic graph whose edges are wires: a node's two inputs are references (indices)
to nodes that stand before it in the table. Networks get tens of thousands of nodes deep, so every stage
goes through the table from one end or the other, or keeps a stack of its own; none recurses.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleLeaf:
    """A module's output. A network has one leaf for each module in it, however often it is used."""

    module: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Suppressor:
    """The dominant's output where that is active, else the inferior's (thesis section 3.2.2).

    With a time constant the dominant dominates until, and not including, `window_ns` after the last frame
    in which it was active; in that time the inferior does not get through. `place` is what `ir.memory` calls
    the time constant.
    """

    dominant: int
    inferior: int
    window_ns: int = 0
    place: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inhibitor:
    """A gate: no output where the dominant is active, else the inferior's. `window_ns` as in `Suppressor`."""

    dominant: int
    inferior: int
    window_ns: int = 0
    place: str = field(default="", compare=False)


NetworkNode = ModuleLeaf | Suppressor | Inhibitor


@dataclass(frozen=True, slots=True, kw_only=True)
class Network:
    """Nodes with inputs before the nodes that use them, and what they are called.

    `outputs` gives the node that drives each wired actuator, in the order in which the robot declares them.
    `wires` gives the node that each named wire stands for, in the order of the program. `observed` gives the
    nodes whose activity contracts and examples ask for, by the name that they use (a wire or a module).
    """

    nodes: tuple[NetworkNode, ...]
    outputs: tuple[tuple[str, int], ...]
    wires: tuple[tuple[str, int], ...] = ()
    observed: tuple[tuple[str, int], ...] = ()
