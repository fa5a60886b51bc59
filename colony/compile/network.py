"""The network as wired: modules, suppressor nodes and inhibitor nodes, as one flat table.

A network is a directed acyclic graph whose edges are wires: a node's two inputs are references (indices)
to earlier nodes of the table. Networks can be tens of thousands of nodes deep, so every stage iterates over
the table in one direction, or has an explicit stack; none recurses.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleLeaf:
    """A module's output. A network has one leaf per module, however often it is used.

    A `failsafe` module's output is active also where something that the module reads is missing.
    """

    module: str
    failsafe: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Suppressor:
    """The dominant input in frames in which it is active, otherwise the inferior one (thesis section 3.2.2).

    With a time constant, the dominant input dominates until, but not including, `window_ns` after the last
    frame in which it was active. `memory_name` is the name of the time constant in `ir.memory`.
    """

    dominant: int
    inferior: int
    window_ns: int = 0
    memory_name: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inhibitor:
    """A gate: no output in frames in which the dominant input is active, otherwise the inferior input.

    `window_ns` and `memory_name` are as in `Suppressor`.
    """

    dominant: int
    inferior: int
    window_ns: int = 0
    memory_name: str = field(default="", compare=False)


NetworkNode = ModuleLeaf | Suppressor | Inhibitor


@dataclass(frozen=True, slots=True, kw_only=True)
class Network:
    """The nodes, each after its inputs, and their names.

    `outputs` gives the node that drives each wired actuator, in the order of their declarations.
    `wires` gives the node of each named wire, in the order of the program. `observed` gives the node
    of each wire or module whose activity contracts or tests read.
    """

    nodes: tuple[NetworkNode, ...]
    outputs: tuple[tuple[str, int], ...]
    wires: tuple[tuple[str, int], ...] = ()
    observed: tuple[tuple[str, int], ...] = ()

    @property
    def failsafe_modules(self) -> tuple[str, ...]:
        """The failsafe modules among the leaves, by name."""
        return tuple(n.module for n in self.nodes if isinstance(n, ModuleLeaf) and n.failsafe)
