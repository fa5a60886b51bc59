"""Lint of safeguards that fail open: without a sensor that only the safeguard reads, the robot drives on.

A *safeguard* of a module m is a module that dominates m somewhere and either inhibits m or, whenever both are
active, restrains a field of m's command. It restrains a field if its own value for the field is the idle
value, lies on the other side of the idle value or, for a speed, lies nearer to it. The evidence is a pair of
runs that differ in one sensor of the last frame only. With all sensors present, the safeguard is active and m
does not win; with that sensor missing, m wins with a command that is not idle. A failsafe safeguard does not
fail open: it is active then too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

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
from colony.verify.lints.evidence import replay
from colony.verify.lints.proof import Prover


def _guarded_claim(module: Module, guard: Module, sensor: str) -> str:
    return f"guarded {module.name} {guard.name} {sensor}"


def _pairs(case: Case) -> Iterator[tuple[Module, Module, Actuator]]:
    """Yield (module that moves the robot, ordinary dominator that needs a further sensor, actuator)."""
    for module, actuator in drivers(case):
        for name in dominators(case, module):
            guard = case.modules.get(name)
            if guard is not None and not guard.failsafe and _own_needs(case, module, guard):
                yield module, guard, actuator


def _own_needs(case: Case, module: Module, guard: Module) -> tuple[str, ...]:
    """Return the sensors that a guard needs and the module does not."""
    return tuple(sorted(case.contents.needs(guard) - case.contents.needs(module)))


def independent_dominators(case: Case, module: Module, sensor: str) -> tuple[str, ...]:
    """Return the modules that dominate a module somewhere and do not need `sensor`."""
    return tuple(
        name
        for name in dominators(case, module)
        if name not in case.modules or sensor not in case.contents.needs(case.modules[name])
    )


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims behind a warning.

    "Open": the module never wins while only this sensor is missing. "Guarded": with all sensors present, the
    module is never kept from moving the robot only by guards that need the sensor. "Restrains": the guard
    restrains a field of the module's command.
    """
    for module, guard, actuator in _pairs(case):
        held_back = (
            *with_all_sensors(case),
            active(module.name),
            active(guard.name),
            negation(won(actuator.name, module.name)),
            drives(module, actuator),
        )
        for sensor in _own_needs(case, module, guard):
            yield open_claim(case, module, actuator, sensor)
            others = (negation(active(name)) for name in independent_dominators(case, module, sensor))
            yield _guarded_claim(module, guard, sensor), negation(all_of((*held_back, *others)))
        yield from restraint_claims(module, guard, actuator)


def findings(case: Case, prover: Prover) -> Iterator[Diagnostic]:
    """Yield the warnings about guards that fail open."""
    found: dict[tuple[str, str], list[str]] = {}
    for module, guard, actuator in _pairs(case):
        sensors = [s for s in _own_needs(case, module, guard) if may_win_without(module, s, prover)]
        fields = guarded_fields(case, module, guard, actuator, prover) if sensors else frozenset[int]()
        for sensor in sensors if fields else ():
            trace = prover.refuted(_guarded_claim(module, guard, sensor))
            if trace is None:
                continue
            outcome = replay(case.program, without(trace.snapshots, sensor))[-1]
            if fields & moving_fields(outcome, module, actuator):
                found.setdefault((module.name, sensor), []).append(guard.name)
    yield from _warnings(case, found)


def _warnings(case: Case, found: Mapping[tuple[str, str], list[str]]) -> Iterator[Diagnostic]:
    """Yield a warning for each module and set of guards."""
    by_guards: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for (module, sensor), guards in found.items():
        by_guards.setdefault((module, tuple(guards)), []).append(sensor)
    for (module, names), sensors in by_guards.items():
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
            f"{cure}, or {inhibitor_hint(sensors, module)}",
        )


def inhibitor_hint(sensors: list[str], module: str) -> str:
    """Return the advice to wire a module that inhibits while a sensor is missing."""
    present = " and ".join(f"fresh({s})" for s in sensors)
    condition = f"not {present}" if len(sensors) == 1 else f"not ({present})"
    return f"wire a module `when {condition}` that inhibits `{module}`"
