"""The network as wired: modules, suppressor nodes and inhibitor nodes, as one flat table.

A network is a directed acyclic graph whose edges are wires: a node's two inputs are references (indices)
to earlier nodes of the table. Networks can be tens of thousands of nodes deep, so every stage iterates over
the table in one direction, or has an explicit stack; none recurses.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from colony.compile.guards import Guard


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


# --- suppression --------------------------------------------------------------------------------------
#
# The network after inhibition elimination: suppressors only, on links that carry gates.
#
# The thesis's Lemma 4.1 turns `A inhibits B` into a module with the guard `not P_A and P_B`. For a network B
# that is shared, this would require a copy. Instead, the guard becomes the *gate* of the link to B, and B
# stays shared: a link passes its node's command on only in frames in which its gate holds.


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeUse:
    """The use of a node, through a gate.

    `gate` and `active` are indices into the guards. The link is open while `gate` holds. It carries a command
    while `active` holds: while it is open and its node is active.
    """

    node: int
    gate: int
    active: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GatedSuppressor:
    """A memoryless suppressor: the dominant link's command if there is one, otherwise the inferior's."""

    dominant: NodeUse
    inferior: NodeUse


SuppressionNode = ModuleLeaf | GatedSuppressor


@dataclass(frozen=True, slots=True, kw_only=True)
class SuppressionNetwork:
    """A pure suppression network N(M, S, L_d, L_i, sigma) for each output, over shared nodes and guards.

    Each node comes after those that it uses. Nodes without a path to an output inhibit, or have no effect.

    Attributes:
        nodes: the modules and suppressors.
        guards: the table of guards.
        outputs: the link that drives each wired actuator.
        wires: the guard for the activity of each named wire.
        observed: the guard for the activity of each wire or module that contracts and tests read.
        windows: the guard of each time constant, by its name in `ir.memory`.
    """

    nodes: tuple[SuppressionNode, ...]
    guards: tuple[Guard, ...]
    outputs: tuple[tuple[str, NodeUse], ...]
    wires: tuple[tuple[str, int], ...] = ()
    observed: tuple[tuple[str, int], ...] = ()
    windows: tuple[tuple[str, int], ...] = field(default=(), compare=False)
