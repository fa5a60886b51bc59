"""Lint of failsafe modules that, blind, hold back a safeguard: the robot drives on without their sensor.

In `(carry inhibits avoid) suppresses cruise` with a failsafe `carry`, a missing sensor of `carry` makes it
active, `avoid` does not get through, and `cruise` drives. The evidence is a pair of runs as for safeguards
that fail open (`fail_open`): with the sensor, `carry` is not active and `avoid` dominates `cruise`.
"""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir.program import AnyModule, Module
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import quoted
from colony.verify.lints.case import Case
from colony.verify.lints.driving import (
    Found,
    Guarded,
    by_guards,
    drivers,
    guarded_fields,
    may_win_without,
    moving_fields,
    undecided_without,
    without,
)
from colony.verify.lints.proof import Prover, frames
from colony.verify.snapshot import Snapshot


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


def findings(case: Case, prover: Prover) -> Iterator[Diagnostic]:
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


def _is_confirmed(case: Case, hold: Guarded, holder: AnyModule, sensor: str, prover: Prover) -> bool:
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
