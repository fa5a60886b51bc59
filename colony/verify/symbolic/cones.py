"""Cones of influence: what a formula depends on, through definitions and through memory of earlier frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

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
    cells = {c.old.get_id(): c for c in system.cells}
    visited: set[int] = set()
    leaves: set[int] = set()
    facts: list[Fact] = []
    constants: list[tuple[str, z3.ExprRef]] = []
    pending = graph.add(terms)
    while pending:
        key = pending.pop()
        if key in visited:
            continue
        visited.add(key)
        pending.extend(graph.operands(key))
        constant = graph.constant(key)
        if constant is None:
            continue
        leaves.add(key)
        if key in cells:
            pending.extend(graph.add([cells[key].next]))
        else:
            constants.append(constant)
        own_facts = system.facts.get(key, ())
        facts += own_facts
        pending.extend(graph.add(fact.formula for fact in own_facts))
    facts.sort(key=lambda fact: fact.position)
    constants.sort(key=lambda named: named[0])
    return Cone(
        system=system,
        cells=tuple(c for key, c in cells.items() if key in visited),
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
