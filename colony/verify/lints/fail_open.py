"""Lint of safeguards that fail open: without a sensor that only the safeguard reads, the robot drives on.

A *safeguard* of a module m is a module that dominates m somewhere and either inhibits m or, whenever both are
active, restrains a field of m's command. It restrains a field if its own value for the field is the idle
value, lies on the other side of the idle value or, for a speed, lies nearer to it. The evidence is a pair of
runs that differ in one sensor of the last frame only. With all sensors present, the safeguard is active and m
does not win; with that sensor missing, m wins with a command that is not idle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from colony.ir.expression import Binary, Expression
from colony.ir.program import Actuator, Module, in_declared_units
from colony.ir.types import Quantity
from colony.text.diagnostics import Diagnostic, warning
from colony.text.units import LENGTH, TIME
from colony.text.wording import quoted
from colony.verify.claims import (
    active,
    all_of,
    any_of,
    binary,
    constant,
    fresh,
    implies,
    negation,
    won,
)
from colony.verify.lints.case import Case, command_of
from colony.verify.lints.evidence import replay
from colony.verify.lints.proof import Prover
from colony.verify.snapshot import Snapshot

_BASE_SERVER = "RServer"


def _open_claim(module: Module, sensor: str) -> str:
    return f"open {module.name} {sensor}"


def _guarded_claim(module: Module, guard: Module, sensor: str) -> str:
    return f"guarded {module.name} {guard.name} {sensor}"


def _restraint_claim(module: Module, guard: Module, i: int) -> str:
    return f"restrains {module.name} {guard.name} {i}"


def _pairs(case: Case) -> Iterator[tuple[Module, Module, Actuator]]:
    """Yield (module that moves the robot, dominating module that needs a further sensor, actuator)."""
    for module in case.own_modules.values():
        actuator = case.actuators.get(module.actuator or "")
        if actuator is None or actuator.server != _BASE_SERVER or actuator.idle is None:
            continue
        dominating = dict.fromkeys(
            name
            for node in case.network.nodes_above(module.name)
            for name in case.network.modules_under(node.dominant)
        )
        for name in dominating:
            guard = case.modules.get(name)
            if guard is not None and guard is not module and _own_needs(case, module, guard):
                yield module, guard, actuator


def _own_needs(case: Case, module: Module, guard: Module) -> tuple[str, ...]:
    """Return the sensors that a guard needs and the module does not."""
    return tuple(sorted(case.contents.needs(guard) - case.contents.needs(module)))


def _independent_dominants(case: Case, module: Module, sensor: str) -> tuple[str, ...]:
    """Return the modules that dominate a module somewhere and do not need `sensor`."""
    dominating = dict.fromkeys(
        name
        for node in case.network.nodes_above(module.name)
        for name in case.network.modules_under(node.dominant)
    )
    needing = {n for n in dominating if n in case.modules and sensor in case.contents.needs(case.modules[n])}
    return tuple(name for name in dominating if name not in needing and name != module.name)


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims behind a warning.

    "Open": the module never wins while only this sensor is missing. "Guarded": with all sensors present, the
    module is never kept from moving the robot only by guards that need the sensor. "Restrains": the guard
    restrains a field of the module's command.
    """
    sensors = [s.name for s in case.program.robot.sensors if s.default is None]
    for module, guard, actuator in _pairs(case):
        assert actuator.idle is not None
        wins = won(actuator.name, module.name)
        for sensor in _own_needs(case, module, guard):
            only_missing = (negation(fresh(s)) if s == sensor else fresh(s) for s in sensors)
            yield _open_claim(module, sensor), negation(all_of((*only_missing, wins)))
        moves = any_of(
            binary(Binary.NOT_EQUAL, command_of(module, i), constant(idle, actuator.fields[i].type))
            for i, idle in enumerate(actuator.idle)
        )
        held_back = (
            *(fresh(s) for s in sensors),
            active(module.name),
            active(guard.name),
            negation(wins),
            moves,
        )
        for sensor in _own_needs(case, module, guard):
            others = (negation(active(name)) for name in _independent_dominants(case, module, sensor))
            yield _guarded_claim(module, guard, sensor), negation(all_of((*held_back, *others)))
        for i in range(len(actuator.fields)):
            if guard.actuator == actuator.name:
                yield _restraint_claim(module, guard, i), _restrained(module, guard, actuator, i)


def findings(case: Case, prover: Prover) -> Iterator[Diagnostic]:
    """Yield the warnings about guards that fail open."""
    found: dict[tuple[str, str], list[str]] = {}
    stays_closed: dict[str, bool] = {}
    for module, guard, actuator in _pairs(case):
        sensors = []
        for sensor in _own_needs(case, module, guard):
            name = _open_claim(module, sensor)
            if name not in stays_closed:
                stays_closed[name] = prover.proved_over_reals(name)
            sensors += [] if stays_closed[name] else [sensor]
        fields = _guarded_fields(case, module, guard, actuator, prover) if sensors else frozenset[int]()
        for sensor in sensors if fields else ():
            trace = prover.refuted(_guarded_claim(module, guard, sensor))
            moving = (
                set[int]()
                if trace is None
                else _moving_fields(case, module, actuator, sensor, trace.snapshots)
            )
            if fields & moving:
                found.setdefault((module.name, sensor), []).append(guard.name)
    yield from _warnings(case, found)


def _moving_fields(
    case: Case, module: Module, actuator: Actuator, sensor: str, snapshots: tuple[Snapshot, ...]
) -> set[int]:
    """Return the fields that are not idle when the module wins in the last frame, without `sensor`."""
    last = snapshots[-1]
    last_without_sensor = last._replace(readings={n: v for n, v in last.readings.items() if n != sensor})
    outcome = replay(case.program, (*snapshots[:-1], last_without_sensor))[-1]
    decision = next(d for d in outcome.decisions if d.actuator == actuator.name)
    idle = in_declared_units(actuator.idle, actuator.fields)
    if decision.by != module.name or decision.fault or decision.values is None or idle is None:
        return set()
    return {i for i, (x, y) in enumerate(zip(decision.values, idle, strict=True)) if x != y}


def _guarded_fields(
    case: Case, module: Module, guard: Module, actuator: Actuator, prover: Prover
) -> frozenset[int]:
    """Return the fields against which `guard` is a safeguard of `module`."""
    fields = range(len(actuator.fields))
    for node in case.network.nodes_above(module.name):
        if node.relation == "inhibits" and guard.name in case.network.modules_under(node.dominant):
            return frozenset(fields)
    if guard.actuator != actuator.name:
        return frozenset()
    return frozenset(i for i in fields if prover.proved([_restraint_claim(module, guard, i)]))


def _restrained(module: Module, guard: Module, actuator: Actuator, i: int) -> Expression:
    """Return the condition that the guard restrains the field whenever both modules are active.

    The guard's field is at idle, on the other side of it or, for a speed, nearer to it. Bools and enumerators
    have no order: their field is at idle in the guard's command if it is not in the module's.
    """
    assert actuator.idle is not None
    kind = actuator.fields[i].type
    idle = constant(actuator.idle[i], kind)
    guard_value, module_value = command_of(guard, i), command_of(module, i)
    both_active = all_of((active(module.name), active(guard.name)))
    if not isinstance(kind, Quantity):
        moves = binary(Binary.NOT_EQUAL, module_value, idle)
        return implies(both_active, implies(moves, binary(Binary.EQUAL, guard_value, idle)))
    is_speed = kind.dimension == LENGTH.over(TIME)
    less, more = (Binary.LESS, Binary.GREATER) if is_speed else (Binary.LESS_EQUAL, Binary.GREATER_EQUAL)
    bound = module_value if is_speed else idle
    return implies(
        both_active,
        all_of(
            (
                implies(binary(Binary.GREATER, module_value, idle), binary(less, guard_value, bound)),
                implies(binary(Binary.LESS, module_value, idle), binary(more, guard_value, bound)),
            )
        ),
    )


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
        present = " and ".join(f"fresh({s})" for s in sensors)
        condition = f"not {present}" if len(sensors) == 1 else f"not ({present})"
        yield warning(
            "V030",
            case.modules[module].span,
            f"with {quoted(sensors, 'or')} missing, `{module}` can drive: {quoted(names)}, {silent}",
            f"wire a module `when {condition}` that inhibits `{module}`",
        )
