"""Lint of safeguards that fail open: without a sensor that only the safeguard reads, the robot drives on.

A *safeguard* of a module m is a module that dominates m somewhere and either inhibits m or, whenever both are
active, restrains a field of m's command. It restrains a field if its own value for the field is the idle
value, lies on the other side of the idle value or, for a speed, lies nearer to it. The evidence is a pair of
runs that differ in one sensor of the last frame only. With all sensors present, the safeguard is active and m
does not win; with that sensor missing, m wins with a command that is not idle. A failsafe safeguard does not
fail open: it is active then too.
"""

from __future__ import annotations

from collections.abc import Iterator, Set
from itertools import islice
from typing import NamedTuple

from colony.ir import expression as ir
from colony.ir.program import Actuator, AnyModule, Module, Sensor
from colony.ir.types import Array, Quantity, ScalarValue, Value, element_type
from colony.ir.walk import all_subexpressions
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import Remedy, quoted
from colony.verify.contracts.concrete_runs import GeneratedRuns, plain_values
from colony.verify.lints.case import Case
from colony.verify.lints.driving import (
    Found,
    Guarded,
    by_guards,
    drivers,
    drives_name,
    guarded_fields,
    independent_dominators,
    inhibitor_hint,
    may_win_without,
    moving_fields,
    open_name,
    undecided_without,
    without,
)
from colony.verify.lints.predicates import never_active
from colony.verify.lints.proof import QUESTION_RESOURCES, LintProver, frames, replay
from colony.verify.snapshot import Snapshot

# --- held back -----------------------------------------------------------------------------------------
#
# Lint of failsafe modules that, blind, hold back a safeguard: the robot drives on without their sensor.
#
# In `(carry inhibits avoid) suppresses cruise` with a failsafe `carry`, a missing sensor of `carry` makes
# it active, `avoid` does not get through, and `cruise` drives. The evidence is a pair of runs as for
# safeguards that fail open (`fail_open`): with the sensor, `carry` is not active and `avoid` dominates
# `cruise`.


def _holds(case: Case) -> Iterator[Guarded]:
    """Yield each module that moves the robot with each dominator that a failsafe module inhibits."""
    failsafe = {name: m for name, m in case.wired_modules.items() if m.failsafe}
    if not failsafe:
        return
    for module, actuator in drivers(case):
        for name in case.network.dominators(module.name):
            guard = case.wired_modules[name]
            for holder in _inhibitors(case, guard):
                if holder in failsafe and holder != module.name:
                    sensors = _sensors(case, module, guard, failsafe[holder])
                    yield Guarded(module, actuator, guard, sensors, failsafe[holder])


def _inhibitors(case: Case, guard: AnyModule) -> tuple[str, ...]:
    """Return the modules that inhibit a module somewhere."""
    return tuple(
        dict.fromkeys(
            name
            for node in case.network.nodes_above(guard.name)
            for name in case.network.modules_under(node.dominant)
            if node.relation == "inhibits" and name != guard.name
        )
    )


def _sensors(case: Case, module: Module, guard: AnyModule, holder: AnyModule) -> tuple[str, ...]:
    """Return the sensors that the holder needs, while the module and the guard are active without them."""
    needed = case.contents.needs(holder) - case.contents.needs(module)
    return tuple(sorted(needed if guard.failsafe else needed - case.contents.needs(guard)))


def held_back_findings(case: Case, prover: LintProver) -> Iterator[Diagnostic]:
    """Yield the warnings about failsafe modules that hold back a guard."""
    found: Found = {}
    undecided: dict[str, list[str]] = {}
    for hold in _holds(case):
        assert hold.holder is not None
        for sensor in hold.sensors:
            if not may_win_without(case, hold.module, hold.actuator, sensor, prover):
                continue
            question = hold.question(case, sensor)
            if _is_confirmed(case, hold, hold.holder, sensor, prover):
                key = (hold.module.name, hold.holder.name), sensor
                found.setdefault(key, []).append(hold.guard.name)
            elif prover.is_undecided(question.name):
                undecided.setdefault(hold.module.name, []).append(sensor)
    for (module, holder), names, sensors in by_guards(found):
        yield warning(
            "V030",
            case.modules[module].span,
            f"with {quoted(sensors, 'or')} missing, `{module}` can drive: `{holder}`, which is failsafe, "
            f"is active then and holds back {quoted(names)}",
            f"wire `{holder}` so that it inhibits `{module}` too",
        )
    yield from undecided_without(case, undecided, ((module, sensor) for (module, _), sensor in found))


def _is_confirmed(case: Case, hold: Guarded, holder: AnyModule, sensor: str, prover: LintProver) -> bool:
    """Return True if a pair of runs shows that the holder holds back the guard."""
    fields = guarded_fields(case, hold.module, hold.guard, hold.actuator, prover)
    return any(
        fields & _moving(case, hold, holder, without(trace.snapshots, sensor))
        for trace in (prover.refutations(hold.question(case, sensor)) if fields else ())
    )


def _moving(case: Case, hold: Guarded, holder: AnyModule, snapshots: tuple[Snapshot, ...]) -> set[int]:
    """Return the fields that move in the last frame, in which the holder is blind and the guard active."""
    *_, (outcome, interpreter) = frames(case.program, snapshots)
    if not (interpreter.is_blind(holder.name) and interpreter.is_active(hold.guard.name)):
        return set()
    return moving_fields(outcome, hold.module, hold.actuator)


# --- fail open -----------------------------------------------------------------------------------------


_MAX_READINGS = 32
"""Number of readings of a sensor that are tried to make its guards active."""


def _pairs(case: Case, module: Module, actuator: Actuator) -> Iterator[Guarded]:
    """Yield a module that moves the robot with each ordinary dominator that needs further sensors."""
    needs = case.contents.needs(module)
    for name in case.network.dominators(module.name):
        guard = case.wired_modules[name]
        if not guard.failsafe:
            yield Guarded(module, actuator, guard, tuple(sorted(case.contents.needs(guard) - needs)))


class _Needed:
    """The sensors that the ordinary dominators of a module need, found without listing the dominators."""

    def __init__(self, case: Case) -> None:
        guards: dict[str, list[str]] = {}
        for name, guard in case.wired_modules.items():
            for sensor in () if guard.failsafe else case.contents.needs(guard):
                guards.setdefault(sensor, []).append(name)
        self._case = case
        self._guards = {sensor: case.network.set_of(names) for sensor, names in guards.items()}

    def beyond(self, module: Module) -> list[str]:
        """Return those of the sensors that the module does not need."""
        needs, dominates = self._case.contents.needs(module), self._case.network.dominates
        return [s for s, guards in self._guards.items() if s not in needs and dominates(guards, module.name)]


class _Shown(NamedTuple):
    """The guards that are active in runs with a sensor, and the module's fields that move without it."""

    guards: frozenset[str]
    fields: frozenset[int]


class _Readings:
    """Evidence from the readings of one sensor in the first frame of a run. Stateful: remembers it.

    It begins with a frame in which a module wins while only the sensor is missing.
    """

    def __init__(self, case: Case, prover: LintProver, runs: GeneratedRuns | None) -> None:
        self._case = case
        self._prover = prover
        self._runs = runs
        self._shown: dict[tuple[str, str], _Shown] = {}
        self._sensors = {s.name: s for s in case.program.robot.sensors}
        self._constants = [
            (x.type, x.value)
            for x in all_subexpressions(case.program)
            if isinstance(x, ir.Constant) and isinstance(x.value, float)
        ]

    def show(self, pair: Guarded, sensor: str, fields: Set[int]) -> bool:
        """Return True if a reading makes the guard hold the module back, which moves a field without it."""
        key = (pair.module.name, sensor)
        if key not in self._shown:
            self._shown[key] = self._tried(pair.module, pair.actuator, sensor)
        guards, moving = self._shown[key]
        return pair.guard.name in guards and bool(moving & fields)

    def _tried(self, module: Module, actuator: Actuator, sensor: str) -> _Shown:
        """Try readings of the sensor until all guards that need it were active."""
        start, runs = self._prover.broken_start(open_name(module, sensor)), self._runs
        nothing = _Shown(frozenset(), frozenset())
        if start is None or runs is None:
            return nothing
        self._prover.effort.charge(QUESTION_RESOURCES)
        missing = without([start], sensor)
        moving = moving_fields(replay(self._case.program, missing)[-1], module, actuator)
        if not moving:
            return nothing
        independent = set(independent_dominators(self._case, module, sensor))
        guards = {name for name in self._case.network.dominators(module.name) if name not in independent}
        found = set[str]()
        for value in islice(self._values(self._sensors[sensor]), _MAX_READINGS):
            if guards <= found:
                break
            snapshot = start._replace(readings={**start.readings, sensor: value})
            [outcome] = runs.outcomes([snapshot])
            active = {name for name in guards if never_active(name) in outcome.breaches}
            if active <= found or drives_name(module) not in outcome.breaches:
                continue
            found |= self._confirmed(module, actuator, snapshot, independent) & guards
        return _Shown(frozenset(found), frozenset(moving))

    def _confirmed(
        self, module: Module, actuator: Actuator, snapshot: Snapshot, independent: Set[str]
    ) -> set[str]:
        """Return the active modules of a frame if only modules that need the sensor hold the module back."""
        [(outcome, interpreter)] = frames(self._case.program, [snapshot])
        wins = any(d.actuator == actuator.name and d.by == module.name for d in outcome.decisions)
        if wins or not interpreter.is_active(module.name) or any(map(interpreter.is_active, independent)):
            return set()
        return {name for name in self._case.wired_modules if interpreter.is_active(name)}

    def _values(self, sensor: Sensor) -> Iterator[Value]:
        """Yield readings of a sensor: the ends of its range, then those next to the program's constants."""
        for x in dict.fromkeys((*plain_values(sensor), *self._near_constants(sensor))):
            yield (x,) * sensor.type.size if isinstance(sensor.type, Array) else x

    def _near_constants(self, sensor: Sensor) -> Iterator[ScalarValue]:
        of = element_type(sensor.type)
        low, high = sensor.low, sensor.high
        if not isinstance(of, Quantity):
            return
        for type_, value in self._constants:
            if isinstance(type_, Quantity) and type_.dimension == of.dimension:
                for x in (value, value * 0.99, value * 1.01):
                    if (low is None or x >= low) and (high is None or x <= high):
                        yield x


def findings(case: Case, prover: LintProver, runs: GeneratedRuns | None) -> Iterator[Diagnostic]:
    """Yield the warnings about guards that fail open."""
    found: Found = {}
    undecided: dict[str, list[str]] = {}
    readings = _Readings(case, prover, runs)
    needed = _Needed(case)
    for module, actuator in drivers(case):
        if prover.effort.is_over():
            beyond = needed.beyond(module)
            if not any(prover.knows(open_name(module, s)) for s in beyond):
                prover.effort.questions_skipped += len(beyond)
                continue
        for pair in _pairs(case, module, actuator):
            sensors = [s for s in pair.sensors if may_win_without(case, module, actuator, s, prover)]
            fields = guarded_fields(case, module, pair.guard, actuator, prover) if sensors else frozenset()
            for sensor in sensors if fields else ():
                if readings.show(pair, sensor, fields) or _fails_open(case, pair, sensor, fields, prover):
                    found.setdefault(((module.name,), sensor), []).append(pair.guard.name)
                elif prover.is_undecided(pair.question(case, sensor).name):
                    undecided.setdefault(module.name, []).append(sensor)
    yield from _warnings(case, found)
    yield from undecided_without(case, undecided, ((module, sensor) for (module,), sensor in found))


def _fails_open(case: Case, pair: Guarded, sensor: str, fields: Set[int], prover: LintProver) -> bool:
    """Return True if the guard holds the module back in a run, and a field moves in it without the sensor."""
    for trace in prover.refutations(pair.question(case, sensor)):
        outcome = replay(case.program, without(trace.snapshots, sensor))[-1]
        if moving_fields(outcome, pair.module, pair.actuator).intersection(fields):
            return True
    return False


def _warnings(case: Case, found: Found) -> Iterator[Diagnostic]:
    """Yield a warning for each module and set of guards."""
    for (module,), names, sensors in by_guards(found):
        is_single = len(names) == 1
        what = "them" if len(sensors) > 1 else "it"
        silent = (
            f"which {'reads' if is_single else 'read'} {what}, {'is' if is_single else 'are'} silent then"
        )
        cure = f"write {quoted([f'failsafe module {name}' for name in names])}"
        yield warning(
            "V030",
            case.modules[module].span,
            f"with {quoted(sensors, 'or')} missing, `{module}` can drive: {quoted(names)}, {silent}",
            Remedy(
                f"{cure}, or {inhibitor_hint(sensors, module)}",
                f"module {names[0]}",
                f"failsafe module {names[0]}",
            ),
        )
