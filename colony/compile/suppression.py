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

    `gate` and `active` are indices into the guards: the link is open; the link carries a command (it is open
    and its node is active).
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
    `wires` and `observed` give guards of activity by name; `windows` gives those of time constants, by their
    names in `ir.memory`.
    """

    nodes: tuple[SuppressionNode, ...]
    guards: tuple[Guard, ...]
    outputs: tuple[tuple[str, Link], ...]
    wires: tuple[tuple[str, int], ...] = ()
    observed: tuple[tuple[str, int], ...] = ()
    windows: tuple[tuple[str, int], ...] = field(default=(), compare=False)
