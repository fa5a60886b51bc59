"""Lint of failsafe modules that, blind, hold back a safeguard: the robot drives on without their sensor.

In `(carry inhibits avoid) suppresses cruise` with a failsafe `carry`, a missing sensor of `carry` makes it
active, `avoid` does not get through, and `cruise` drives. The evidence is a pair of runs as for safeguards
that fail open (`fail_open`): with the sensor, `carry` is not active and `avoid` dominates `cruise`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple, Self

from colony.ir.expression import Expression
from colony.ir.program import Actuator, Module
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import quoted
from colony.verify.claims import active, all_of, negation, won
from colony.verify.lints.case import Case
from colony.verify.lints.driving import (
    dominators,
    drivers,
    drives,
    guarded_fields,
    may_win_without,
    moving_fields,
    open_claim,
    restraint_claims,
    with_all_sensors,
    without,
)
from colony.verify.lints.fail_open import independent_dominators
from colony.verify.lints.proof import Prover, TimeBudget
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot


class _Hold(NamedTuple):
    """A failsafe `holder` that inhibits a dominator of `module` where one of `sensors` is missing."""

    module: Module
    actuator: Actuator
    guard: Module
    holder: Module
    sensors: tuple[str, ...]

    def claim(self, sensor: str) -> str:
        return f"held back {self.module.name} {self.guard.name} {self.holder.name} {sensor}"

    def only(self, sensors: Iterable[str]) -> Self:
        return self._replace(sensors=tuple(sensors))


def _holds(case: Case) -> Iterator[_Hold]:
    failsafe = {name: m for name, m in case.modules.items() if m.failsafe}
    if not failsafe:
        return
    for module, actuator in drivers(case):
        for name in dominators(case, module):
            guard = case.modules.get(name)
            if guard is None:
                continue
            for holder in _inhibitors(case, guard):
                if holder in failsafe and holder != module.name:
                    sensors = _sensors(case, module, guard, failsafe[holder])
                    yield _Hold(module, actuator, guard, failsafe[holder], sensors)


def _inhibitors(case: Case, guard: Module) -> tuple[str, ...]:
    """Return the modules that inhibit a module somewhere."""
    return tuple(
        dict.fromkeys(
            name
            for node in case.network.nodes_above(guard.name)
            for name in case.network.modules_under(node.dominant)
            if node.relation == "inhibits" and name != guard.name
        )
    )


def _sensors(case: Case, module: Module, guard: Module, holder: Module) -> tuple[str, ...]:
    """Return the sensors that the holder needs, while the module and the guard are active without them."""
    needed = case.contents.needs(holder) - case.contents.needs(module)
    return tuple(sorted(needed if guard.failsafe else needed - case.contents.needs(guard)))


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a module never wins while only this sensor is missing (`driving.open_claim`)."""
    for hold in _holds(case):
        for sensor in hold.sensors:
            yield open_claim(case, hold.module, hold.actuator, sensor)


def _hold_claims(case: Case, hold: _Hold) -> Iterator[tuple[str, Expression]]:
    """Yield the claims behind a warning.

    "Held back": with all sensors present, the guard never keeps the module from moving the robot while the
    holder is not active. "Restrains": the guard restrains a field of the module's command.
    """
    guarded = (
        *with_all_sensors(case),
        active(hold.module.name),
        active(hold.guard.name),
        negation(active(hold.holder.name)),
        negation(won(hold.actuator.name, hold.module.name)),
        drives(hold.module, hold.actuator),
    )
    for sensor in hold.sensors:
        others = (
            negation(active(name))
            for name in independent_dominators(case, hold.module, sensor)
            if name not in (hold.guard.name, hold.holder.name)
        )
        yield hold.claim(sensor), negation(all_of((*guarded, *others)))
    yield from restraint_claims(hold.module, hold.guard, hold.actuator)


def findings(case: Case, prover: Prover, time_budget: TimeBudget) -> Iterator[Diagnostic]:
    """Yield the warnings about failsafe modules that hold back a guard."""
    holds = [h.only(s for s in h.sensors if may_win_without(h.module, s, prover)) for h in _holds(case)]
    asked = Prover(
        case.instrumented,
        dict(claim for h in holds if h.sensors for claim in _hold_claims(case, h)),
        time_budget,
    )
    found: dict[tuple[str, str, str], list[str]] = {}
    for hold in holds:
        for sensor in hold.sensors:
            if _is_confirmed(case, hold, sensor, asked):
                key = (hold.module.name, hold.holder.name, sensor)
                found.setdefault(key, []).append(hold.guard.name)
    by_guards: dict[tuple[str, str, tuple[str, ...]], list[str]] = {}
    for (module, holder, sensor), guards in found.items():
        by_guards.setdefault((module, holder, tuple(guards)), []).append(sensor)
    for (module, holder, names), sensors in by_guards.items():
        yield warning(
            "V030",
            case.modules[module].span,
            f"with {quoted(sensors, 'or')} missing, `{module}` can drive: `{holder}`, which is failsafe, "
            f"is active then and holds back {quoted(names)}",
            f"wire `{holder}` so that it inhibits `{module}` too",
        )


def _is_confirmed(case: Case, hold: _Hold, sensor: str, prover: Prover) -> bool:
    """Return True if a pair of runs shows it."""
    fields = guarded_fields(case, hold.module, hold.guard, hold.actuator, prover)
    trace = prover.refuted(hold.claim(sensor)) if fields else None
    return trace is not None and bool(fields & _moving(case, hold, without(trace.snapshots, sensor)))


def _moving(case: Case, hold: _Hold, snapshots: tuple[Snapshot, ...]) -> set[int]:
    """Return the fields that move in the last frame, in which the holder is blind and the guard active."""
    interpreter = Interpreter(case.program, answers_given=True)
    outcomes = [interpreter.step_in_base_units(s.t_ns, s.readings) for s in snapshots]
    if not (interpreter.is_blind(hold.holder.name) and interpreter.is_active(hold.guard.name)):
        return set()
    return moving_fields(outcomes[-1], hold.module, hold.actuator)
