"""The network after inhibition elimination: suppressors only, on links that carry gates.

The thesis's Lemma 4.1 turns `A inhibits B` into a module with the guard `not P_A and P_B`. For a network B
that is shared, this would require a copy. Instead, the guard becomes the *gate* of the link to B, and B stays
shared: a link passes its node's command on only in frames in which its gate holds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from colony.compile.guards import Guard
from colony.compile.network import ModuleLeaf


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
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

    dominant: Link
    inferior: Link


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
    outputs: tuple[tuple[str, Link], ...]
    wires: tuple[tuple[str, int], ...] = ()
    observed: tuple[tuple[str, int], ...] = ()
    windows: tuple[tuple[str, int], ...] = field(default=(), compare=False)
