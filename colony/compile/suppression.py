"""The network after inhibition elimination: suppressors only, on links that carry gates.

The thesis's Lemma 4.1 turns `A inhibits B` into a module with the guard `not P_A and P_B`. For a network B
that is shared, this would require a copy. So the guard is put on the link to B as its *gate*, and B stays
shared: a link passes its node's command on in the frames in which its gate holds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from colony.compile.guards import Guard
from colony.compile.network import ModuleLeaf


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """The use of a node, through a gate.

    `gate` and `active` refer to the table of guards: when the link is open, and when it carries a command
    (it is open and its node is active).
    """

    node: int
    gate: int
    active: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GatedSuppressor:
    """A memoryless suppressor: the dominant link's output if there is one, else the inferior's."""

    dominant: Link
    inferior: Link


SuppressionNode = ModuleLeaf | GatedSuppressor


@dataclass(frozen=True, slots=True, kw_only=True)
class SuppressionNetwork:
    """A pure suppression network N(M, S, L_d, L_i, sigma) for each output, over shared nodes and guards.

    Nodes come after those that they use. Nodes that no output reaches only inhibit, or drive nothing. `wires`
    and `observed` give the activity of the wires of those names, `windows` the guards of time constants, by
    their names in `ir.memory`.
    """

    nodes: tuple[SuppressionNode, ...]
    guards: tuple[Guard, ...]
    outputs: tuple[tuple[str, Link], ...]
    wires: tuple[tuple[str, int], ...] = ()
    observed: tuple[tuple[str, int], ...] = ()
    windows: tuple[tuple[str, int], ...] = field(default=(), compare=False)
