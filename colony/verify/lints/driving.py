"""Modules that move the robot, what keeps them from it, and runs in which a sensor is lost.

The lints of robots that drive on without a sensor (V030) share these claims and runs. Each finding rests on a
pair of runs that differ in one sensor of the last frames only: with it the robot is held back, without it a
module drives.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from colony.ir.expression import Binary, Expression
from colony.ir.frame import Decision, Outcome
from colony.ir.program import Actuator, Module, in_declared_units
from colony.ir.types import Quantity, Scalar, ScalarValue
from colony.text.units import LENGTH, TIME
from colony.verify.claims import (
    active,
    all_of,
    any_of,
    binary,
    constant,
    fresh,
    implies,
    negation,
    value_or,
    won,
)
from colony.verify.lints.case import Case, command_of
from colony.verify.lints.proof import Prover
from colony.verify.snapshot import Snapshot

_BASE_SERVER = "RServer"


def drivers(case: Case) -> Iterator[tuple[Module, Actuator]]:
    """Yield each module of the main file that moves the robot, and its actuator, which can idle."""
    for module in case.own_modules.values():
        actuator = case.actuators.get(module.actuator or "")
        if actuator is not None and actuator.server == _BASE_SERVER and actuator.idle is not None:
            yield module, actuator


def dominators(case: Case, module: Module) -> tuple[str, ...]:
    """Return the other modules that dominate a module somewhere."""
    found = dict.fromkeys(
        name
        for node in case.network.nodes_above(module.name)
        for name in case.network.modules_under(node.dominant)
    )
    return tuple(name for name in found if name != module.name)


def with_all_sensors(case: Case) -> Iterator[Expression]:
    """Yield the conditions that every sensor without a default is present."""
    return (fresh(s.name) for s in case.program.robot.sensors if s.default is None)


def drives(module: Module, actuator: Actuator) -> Expression:
    """Return the condition that an active module's command is not the idle command."""
    assert actuator.idle is not None
    return any_of(
        binary(Binary.NOT_EQUAL, command_of(module, i), constant(idle, actuator.fields[i].type))
        for i, idle in enumerate(actuator.idle)
    )


# --- sensors that a module can drive without -----------------------------------------------------------


def open_claim(case: Case, module: Module, actuator: Actuator, sensor: str) -> tuple[str, Expression]:
    """Return the claim that a module never wins while only this sensor is missing, and its name."""
    names = (s.name for s in case.program.robot.sensors if s.default is None)
    only_missing = (negation(fresh(s)) if s == sensor else fresh(s) for s in names)
    claim = negation(all_of((*only_missing, won(actuator.name, module.name))))
    return _open_name(module, sensor), claim


def may_win_without(module: Module, sensor: str, prover: Prover) -> bool:
    """Return False if a module is proved never to win while only this sensor is missing."""
    return not prover.proved_over_reals(_open_name(module, sensor))


def _open_name(module: Module, sensor: str) -> str:
    return f"open {module.name} {sensor}"


# --- safeguards ----------------------------------------------------------------------------------------


def restraint_claims(module: Module, guard: Module, actuator: Actuator) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a guard restrains a field of a module's command whenever both are active."""
    if guard.actuator == actuator.name:
        for i in range(len(actuator.fields)):
            yield _restraint_name(module, guard, i), _restrained(module, guard, actuator, i)


def _restraint_name(module: Module, guard: Module, i: int) -> str:
    return f"restrains {module.name} {guard.name} {i}"


def guarded_fields(
    case: Case, module: Module, guard: Module, actuator: Actuator, prover: Prover
) -> frozenset[int]:
    """Return the fields against which `guard` is a safeguard of `module`."""
    fields = range(len(actuator.fields))
    for node in case.network.nodes_above(module.name):
        if node.relation == "inhibits" and guard.name in case.network.modules_under(node.dominant):
            return frozenset(fields)
    if guard.actuator != actuator.name:
        return frozenset()
    return frozenset(i for i in fields if prover.proved([_restraint_name(module, guard, i)]))


def _restrained(module: Module, guard: Module, actuator: Actuator, i: int) -> Expression:
    """Return the condition that the guard restrains the field whenever both modules are active.

    The guard's field is at idle, on the other side of it or, for a speed, nearer to it. Bools and enumerators
    have no order: their field is at idle in the guard's command if it is not in the module's. A module that
    is blind commands idle.
    """
    assert actuator.idle is not None
    kind = actuator.fields[i].type
    idle = constant(actuator.idle[i], kind)
    guard_value = value_or(command_of(guard, i), idle)
    module_value = value_or(command_of(module, i), idle)
    both_active = all_of((active(module.name), active(guard.name)))
    if not isinstance(kind, Quantity):
        moves = binary(Binary.NOT_EQUAL, module_value, idle)
        return implies(both_active, implies(moves, binary(Binary.EQUAL, guard_value, idle)))
    is_speed = _is_speed(kind)
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


def _is_speed(kind: Scalar) -> bool:
    return isinstance(kind, Quantity) and kind.dimension == LENGTH.over(TIME)


# --- runs ----------------------------------------------------------------------------------------------


def without(snapshots: Sequence[Snapshot], sensor: str, frames: int = 1) -> tuple[Snapshot, ...]:
    """Return a run in which a sensor is missing in the last frames."""
    kept = len(snapshots) - frames
    lost = (
        s._replace(readings={n: v for n, v in s.readings.items() if n != sensor}) for s in snapshots[kept:]
    )
    return (*snapshots[:kept], *lost)


def moving_fields(outcome: Outcome, module: Module, actuator: Actuator) -> set[int]:
    """Return the fields that are not idle in the command of a module that wins, none if it does not win."""
    decision, idle = _decision(outcome, actuator), in_declared_units(actuator.idle, actuator.fields)
    if decision.by != module.name or decision.fault or decision.values is None or idle is None:
        return set()
    return {i for i, (x, y) in enumerate(zip(decision.values, idle, strict=True)) if x != y}


def is_held_back(outcome: Outcome, free: Outcome, module: Module, actuator: Actuator) -> bool:
    """Return True if a module that drives in `free` does not win in `outcome`, and the robot is restrained.

    A field of the module's command is restrained then, and no speed is farther from idle.
    """
    held, driving = _decision(outcome, actuator), _decision(free, actuator)
    idle = in_declared_units(actuator.idle, actuator.fields)
    if held.by == module.name or held.values is None or driving.values is None or idle is None:
        return False
    fields = [
        (x, y, z, f.type)
        for x, y, z, f in zip(held.values, driving.values, idle, actuator.fields, strict=True)
    ]
    if any(_is_speed(kind) and abs(x - rest) > abs(y - rest) for x, y, rest, kind in fields):
        return False
    moving = moving_fields(free, module, actuator)
    return any(_restrains(*fields[i]) for i in moving)


def _restrains(held: ScalarValue, free: ScalarValue, idle: ScalarValue, kind: Scalar) -> bool:
    """Return True if a field that is not idle, `free`, is restrained at the value `held` (`_restrained`)."""
    if not isinstance(kind, Quantity):
        return held == idle
    if _is_speed(kind):
        return held < free if free > idle else held > free
    return held <= idle if free > idle else held >= idle


def _decision(outcome: Outcome, actuator: Actuator) -> Decision:
    return next(d for d in outcome.decisions if d.actuator == actuator.name)
