"""Cones of influence: what a formula depends on, through definitions and through memory of earlier frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import z3

from colony.verify.symbolic.system import Cell, Number, Scalar, System


@dataclass(frozen=True, slots=True, kw_only=True)
class Cone:
    """The part of a system that some terms depend on, in the system's order.

    `constants` are all constants of a frame except the cells: inputs and auxiliary ones. `visited` are the
    ids of all terms in the cone.
    """

    system: System
    cells: tuple[Cell, ...]
    definitions: tuple[z3.BoolRef, ...]
    assumptions: tuple[z3.BoolRef, ...]
    invariants: tuple[z3.BoolRef, ...]
    constants: tuple[z3.ExprRef, ...]
    visited: frozenset[int]


def cone(system: System, terms: Iterable[z3.ExprRef]) -> Cone:
    """Return the cone of influence of `terms`: the least part of `system` that they depend on."""
    graph = system.graph
    cells = {c.old.get_id(): c for c in system.cells}
    visited: set[int] = set()
    facts: set[int] = set()
    constants: list[z3.ExprRef] = []
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
        if key in cells:
            pending.extend(graph.add([cells[key].next]))
        else:
            constants.append(constant)
        formulas = graph.add(fact.formula for fact in system.facts.get(key, ()))
        facts.update(formulas)
        pending.extend(formulas)
    return Cone(
        system=system,
        cells=tuple(c for key, c in cells.items() if key in visited),
        definitions=_with_ids(system.definitions, facts),
        assumptions=_with_ids(system.assumptions, facts),
        invariants=_with_ids(system.invariants, facts),
        constants=tuple(sorted(constants, key=lambda c: str(c.decl().name()))),
        visited=frozenset(visited),
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


def _with_ids(formulas: tuple[z3.BoolRef, ...], ids: set[int]) -> tuple[z3.BoolRef, ...]:
    return tuple(x for x in formulas if x.get_id() in ids)
