"""Cones of influence: what a formula depends on, through definitions and through memory of earlier frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from operator import itemgetter

import z3

from colony.verify.symbolic.system import Cell, Fact, FactKind, Number, Scalar, System


@dataclass(frozen=True, slots=True, kw_only=True)
class Cone:
    """The part of a system that some terms depend on, in the system's order.

    `constants` are all constants of a frame except the cells: inputs and auxiliary ones. `visited` are the
    ids of all terms in the cone, `leaves` those of its constants and cells.
    """

    system: System
    cells: tuple[Cell, ...]
    definitions: tuple[z3.BoolRef, ...]
    assumptions: tuple[z3.BoolRef, ...]
    invariants: tuple[z3.BoolRef, ...]
    constants: tuple[z3.ExprRef, ...]
    visited: frozenset[int]
    leaves: frozenset[int]


def cone(system: System, terms: Iterable[z3.ExprRef]) -> Cone:
    """Return the cone of influence of `terms`: the least part of `system` that they depend on."""
    graph = system.graph
    reach = graph.reach(graph.add(terms))
    visited, leaves, pending = set(reach.visited), set(reach.leaves), list(reach.leaves)
    facts: list[Fact] = []
    while pending:
        leaf = pending.pop()
        own_facts = system.facts.get(leaf, ())
        facts += own_facts
        behind = graph.behind(leaf, own_facts)
        visited |= behind.visited
        pending += behind.leaves - leaves
        leaves |= behind.leaves
    facts.sort(key=lambda fact: fact.position)
    cells = {c.old.get_id(): c for c in system.cells}
    constants = sorted((graph.constant(leaf) for leaf in leaves - cells.keys()), key=itemgetter(0))
    return Cone(
        system=system,
        cells=tuple(c for key, c in cells.items() if key in leaves),
        definitions=tuple(f.formula for f in facts if f.kind is FactKind.DEFINITION),
        assumptions=tuple(f.formula for f in facts if f.kind is FactKind.ASSUMPTION),
        invariants=tuple(f.formula for f in facts if f.kind is FactKind.INVARIANT),
        constants=tuple(constant for _, constant in constants),
        visited=frozenset(visited),
        leaves=frozenset(leaves),
    )


def whole_cone(system: System) -> Cone:
    """Return all of a system as a cone, including unused inputs."""
    everything: list[z3.ExprRef] = [system.now, system.restarted, *(c.old for c in system.cells)]
    everything += [*system.assumptions, *system.definitions]
    for sensor in system.sensors.values():
        everything += [sensor.present, *_parts(sensor.elements)]
    for answer in system.python.values():
        everything += [answer.answers, answer.blind, *_parts(answer.fields)]
    return cone(system, everything)


def _parts(scalars: Iterable[Scalar]) -> list[z3.ExprRef]:
    parts: list[z3.ExprRef] = []
    for x in scalars:
        parts += (x.value, x.nan, x.infinite) if isinstance(x, Number) else (x,)
    return parts
