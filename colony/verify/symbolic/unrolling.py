"""Unrolling of a system over consecutive frames: its constants renamed frame by frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from operator import itemgetter
from typing import TypeVar, cast

import z3

from colony.ir.frame import OverriddenCommand
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, Enum, ScalarValue, Value, element_type
from colony.ir.types import Scalar as ScalarType
from colony.verify.reference.boundary import clamp
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.logic import is_false
from colony.verify.symbolic.system import (
    ContractFormula,
    DisturbanceInputs,
    ExtendedReal,
    Fact,
    FactKind,
    Inexact,
    Reason,
    Scalar,
    SensorInput,
    SymbolicCell,
    System,
)

# --- cones --------------------------------------------------------------------------------------------
#
# Cones of influence: what a formula depends on, through definitions and through memory of earlier frames.


@dataclass(frozen=True, slots=True, kw_only=True)
class Cone:
    """The part of a system that some terms depend on, in the system's order.

    `constants` are all constants of a frame except the cells: inputs and auxiliary ones. `visited` are the
    ids of all terms in the cone, `leaves` those of its constants and cells.
    """

    system: System
    cells: tuple[SymbolicCell, ...]
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
        parts += (x.value, x.nan, x.infinite) if isinstance(x, ExtendedReal) else (x,)
    return parts


# --- reasons ------------------------------------------------------------------------------------------
#
# Reasons for inexactness: why a formula differs from what the program computes bit for bit.


def reasons_of(system: System, *terms: z3.ExprRef) -> tuple[Reason, ...]:
    """Return the reasons of all inexact terms that `terms` depend on over all frames, each once.

    Comparisons, choices, minimum and maximum, negation, constants and copies are exact.
    """
    if not system.inexact:
        return ()
    visited = cone(system, terms).visited
    found = {inexact_term.reason: None for key, inexact_term in system.inexact.items() if key in visited}
    return tuple(found)


def rounding_reasons(claims: Iterable[ContractFormula]) -> tuple[Reason, ...]:
    """Return the places where reals stand in for floats in a contract or in the lemmas of its proof."""
    reasons = dict.fromkeys(r for claim in claims for r in claim.inexact)
    return tuple(r for r in reasons if r.kind is Inexact.ROUNDING)


# --- substitution -------------------------------------------------------------------------------------
#
# Substitution of the same subterms in many terms.

TermT = TypeVar("TermT", bound=z3.ExprRef)

_MAIN = z3.main_ctx()


class Substitution:
    """Replaces `before[i]` by `after[i]`, the largest terms first. Mutable: caches results.

    `z3.substitute` checks every pair in every call, which dominates the run time with thousands of terms;
    this passes z3 the same two arrays each time.
    """

    def __init__(self, before: Sequence[z3.ExprRef], after: Sequence[z3.ExprRef]) -> None:
        assert all(x.sort() == y.sort() for x, y in zip(before, after, strict=True))
        self._count = len(before)
        self._kept = (*before, *after)
        self._before = (z3.Ast * self._count)(*(x.as_ast() for x in before))
        self._after = (z3.Ast * self._count)(*(x.as_ast() for x in after))
        self._cache: dict[int, tuple[z3.ExprRef, z3.ExprRef]] = {}

    def __call__(self, term: TermT) -> TermT:
        """Return the term with all replacements made."""
        key = term.get_id()
        if key not in self._cache:
            self._cache[key] = (term, self._substitute(term))
        return cast(TermT, self._cache[key][1])

    def _substitute(self, term: z3.ExprRef) -> z3.ExprRef:
        ast = z3.Z3_substitute(_MAIN.ref(), term.as_ast(), self._count, self._before, self._after)
        if ast.value == term.as_ast().value:
            return term
        return z3.BoolRef(ast, _MAIN) if isinstance(term, z3.BoolRef) else z3.ArithRef(ast, _MAIN)


# --- unrolling ----------------------------------------------------------------------------------------


class Unrolling:
    """Frames 0, 1, ... of the part of `system` in `cone` (of all of it if None).

    Mutable: caches renamed terms. The constants of frame i are called `name@i`; a cell at i has its
    value before frame i.
    """

    def __init__(self, system: System, cone: Cone | None = None) -> None:
        self.system = system
        self.cone = whole_cone(system) if cone is None else cone
        self._constants = (*self.cone.constants, *(c.old for c in self.cone.cells))
        self._renamings: list[Substitution] = []

    def at(self, i: int, term: TermT) -> TermT:
        """Return `term`, which must be within the cone, in frame i."""
        while len(self._renamings) <= i:
            frame = len(self._renamings)
            renamed = [z3.Const(f"{c.decl().name()}@{frame}", c.sort()) for c in self._constants]
            self._renamings.append(Substitution(self._constants, renamed))
        return self._renamings[i](term)

    def step(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the formulas of frame i and of its transition to frame i + 1."""
        return (*self.frame(i), *self.transition(i))

    def frame(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the assumptions and definitions of frame i."""
        return tuple(self.at(i, x) for x in (*self.cone.assumptions, *self.cone.definitions))

    def transition(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the equations between each cell at i + 1 and its value after frame i."""
        return tuple(cast(z3.BoolRef, self.at(i + 1, c.old) == self.at(i, c.next)) for c in self.cone.cells)

    def initial(self) -> tuple[z3.BoolRef, ...]:
        """Return the equations between each cell at 0 and its initial value."""
        return tuple(cast(z3.BoolRef, self.at(0, c.old) == c.initial) for c in self.cone.cells)

    def invariants(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the invariants of the cells before frame i."""
        return tuple(self.at(i, x) for x in self.cone.invariants)


class OneFrame(Unrolling):
    """A single frame, in the system's own constants."""

    def at(self, i: int, term: TermT) -> TermT:
        """Return `term`; `i` is 0."""
        assert i == 0
        return term


# --- witness ------------------------------------------------------------------------------------------
#
# The snapshots of a z3 model: its readings and answers as the interpreter takes them.

_DIGITS = 30  # of approximations of algebraic numbers; more than a float has


def snapshots(
    model: z3.ModelRef, unrolling: Unrolling, count: int, late: DisturbanceInputs | None = None
) -> tuple[Snapshot, ...]:
    """Return the first `count` frames of a model of `unrolling`, with what is late in them.

    Numbers are the floats nearest to the model's reals, within the sensor's range; times are exact. A sensor
    is missing if nothing depends on it.
    """
    frames = (_snapshot(model, unrolling, i) for i in range(count))
    if late is None:
        return tuple(frames)
    return tuple(_with_late(frame, model, unrolling, i, late) for i, frame in enumerate(frames))


def _with_late(
    snapshot: Snapshot, model: z3.ModelRef, unrolling: Unrolling, i: int, late: DisturbanceInputs
) -> Snapshot:
    """Return a frame with the actuators that are idle and the modules that are lost in it."""

    def holding(conditions: Mapping[str, z3.BoolRef]) -> list[str]:
        visited = unrolling.cone.visited
        return [
            name
            for name, condition in conditions.items()
            if condition.get_id() in visited and _truth(model, unrolling.at(i, condition))
        ]

    given = {actuator: OverriddenCommand() for actuator in holding(late.idle)}
    return snapshot._replace(given=given, lost=frozenset(holding(late.lost)))


def _snapshot(model: z3.ModelRef, unrolling: Unrolling, i: int) -> Snapshot:
    system, visited = unrolling.system, unrolling.cone.visited
    sensors = {s.name: s for s in system.program.robot.sensors}
    readings: dict[str, Value | None] = {
        name: _reading(model, unrolling, i, sensors[name], sensor_input)
        for name, sensor_input in system.sensors.items()
        if _is_used(sensor_input, visited) and _truth(model, unrolling.at(i, sensor_input.present))
    }
    for name, sensor_input in system.sensors.items():
        sent = sensors[name].sent
        if name not in readings and sent is not None and _is_used(sensor_input, visited):
            # without it, it would be what the program itself sent
            readings[name] = None if isinstance(sent.of, int) else False
    answers: dict[str, tuple[ScalarValue, ...] | None] = {}
    for name, python_input in system.python.items():
        if python_input.blind.get_id() in visited and _truth(model, unrolling.at(i, python_input.blind)):
            answers[name] = None
        elif python_input.answers.get_id() in visited and _truth(
            model, unrolling.at(i, python_input.answers)
        ):
            answers[name] = tuple(value_in(model, unrolling, i, x) for x in python_input.fields)
    restarted = system.restarted.get_id() in visited and _truth(model, unrolling.at(i, system.restarted))
    return Snapshot(_time_ns(model, unrolling, i), readings, answers, restarted)


def _time_ns(model: z3.ModelRef, unrolling: Unrolling, i: int) -> int:
    """Return the time of frame i; frames are one period apart if nothing depends on time."""
    system = unrolling.system
    if system.now.get_id() not in unrolling.cone.visited:
        return i * system.program.robot.frame_ns
    return int(_rational(_evaluated(model, unrolling.at(i, system.now))))


def _is_used(sensor_input: SensorInput, visited: frozenset[int]) -> bool:
    """Return True if any formula in the cone depends on the sensor."""
    terms = [sensor_input.present]
    for x in sensor_input.elements:
        terms += [x.infinite] if isinstance(x, ExtendedReal) else [x]
    values = [x.value for x in sensor_input.elements if isinstance(x, ExtendedReal)]
    return any(term.get_id() in visited for term in (*terms, *values) if not z3.is_false(term))


def _reading(
    model: z3.ModelRef, unrolling: Unrolling, i: int, sensor: Sensor, sensor_input: SensorInput
) -> Value:
    type_ = element_type(sensor.type)
    known: dict[int, tuple[z3.ExprRef, float]] = {}
    values = [
        _valid_value(value_in(model, unrolling, i, x, known), type_, sensor) for x in sensor_input.elements
    ]
    return tuple(values) if isinstance(sensor.type, Array) else values[0]


def _valid_value(x: ScalarValue, type_: ScalarType, sensor: Sensor) -> ScalarValue:
    """Return a value that the sensor can have: a model is arbitrary where nothing depends on it."""
    if isinstance(type_, Enum):
        members = [v for _, v in type_.members]
        return x if x in members else members[0]
    return x if isinstance(type_, Bool) else clamp(x, sensor.low, sensor.high)


# --- values --------------------------------------------------------------------------------------


def value_in(
    model: z3.ModelRef,
    unrolling: Unrolling,
    i: int,
    x: Scalar,
    known: dict[int, tuple[z3.ExprRef, float]] | None = None,
) -> ScalarValue:
    """Return the value of a scalar of the system in frame i of a model, as the nearest float.

    `known` keeps numerals and their floats by id: most of the elements of an array are equal.
    """
    if not isinstance(x, ExtendedReal):
        return _truth(model, unrolling.at(i, x))
    if not is_false(x.nan) and _truth(model, unrolling.at(i, x.nan)):
        return math.nan
    numeral = _evaluated(model, unrolling.at(i, x.value))
    if not is_false(x.infinite) and _truth(model, unrolling.at(i, x.infinite)):
        return math.inf if _rational(numeral) > 0 else -math.inf
    known = {} if known is None else known
    key = numeral.get_id()
    if key not in known:
        known[key] = numeral, _nearest_float(_rational(numeral))
    return known[key][1]


def _evaluated(model: z3.ModelRef, term: z3.ExprRef) -> z3.ExprRef:
    return model.eval(term, model_completion=True)


def _truth(model: z3.ModelRef, term: z3.BoolRef) -> bool:
    return bool(z3.is_true(_evaluated(model, term)))


def _rational(value: z3.ExprRef) -> Fraction:
    """Return a numeral of a model; an algebraic number is rounded, to more digits than a float has."""
    if isinstance(value, z3.AlgebraicNumRef):
        value = value.approx(_DIGITS)
    if isinstance(value, z3.IntNumRef):
        return Fraction(value.as_long())
    assert isinstance(value, z3.RatNumRef), f"{value} is not a number"
    return Fraction(value.numerator_as_long(), value.denominator_as_long())


def _nearest_float(value: Fraction) -> float:
    """Return the nearest finite float."""
    try:
        return float(value)
    except OverflowError:
        return _MAX_FLOAT if value > 0 else -_MAX_FLOAT


_MAX_FLOAT = math.nextafter(math.inf, 0.0)
