"""Modules that move the robot, what keeps them from it, and runs in which a sensor is lost.

The lints of robots that drive on without a sensor (V030) share these claims and runs. Each finding rests on a
pair of runs that differ in one sensor of the last frames only: with it the robot is held back, without it a
module drives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple, Self

from colony.ir.expression import Binary, Constant, Expression
from colony.ir.frame import Decision, Outcome
from colony.ir.program import Actuator, AnyModule, Module, in_declared_units
from colony.ir.types import Quantity, Scalar, ScalarValue, is_rate
from colony.text.diagnostics import Diagnostic
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
    value_or,
    won,
)
from colony.verify.lints.case import Case, command_of
from colony.verify.lints.proof import LintProver, Question, undecided
from colony.verify.snapshot import Snapshot

_BASE_SERVER = "RServer"


def drivers(case: Case) -> Iterator[tuple[Module, Actuator]]:
    """Yield each module of the main file that moves the robot, and its actuator, which can idle."""
    for module in case.own_modules.values():
        actuator = case.actuators.get(module.actuator or "")
        if actuator is not None and actuator.idle is not None and moves(actuator):
            yield module, actuator


def moves(actuator: Actuator) -> bool:
    """Return True for the base, and for what takes speeds or rates."""
    return actuator.server == _BASE_SERVER or any(is_rate(f.type) for f in actuator.fields)


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


def drives_claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a module never commands anything but idle while it is active."""
    for module, actuator in drivers(case):
        yield drives_name(module), implies(active(module.name), negation(drives(module, actuator)))


def drives_name(module: Module) -> str:
    """Return the name of the claim that a module never commands anything but idle while it is active."""
    return f"drives {module.name}"


# --- sensors that a module can drive without -----------------------------------------------------------


def open_question(case: Case, module: Module, actuator: Actuator, sensor: str) -> Question:
    """Return the question if a module never wins while only this sensor is missing."""

    def claim() -> Expression:
        names = (s.name for s in case.program.robot.sensors if s.default is None)
        only_missing = (negation(fresh(s)) if s == sensor else fresh(s) for s in names)
        return negation(all_of((*only_missing, won(actuator.name, module.name))))

    return Question(open_name(module, sensor), claim)


def may_win_without(case: Case, module: Module, actuator: Actuator, sensor: str, prover: LintProver) -> bool:
    """Return False if a module is proved never to win while only this sensor is missing."""
    return not prover.proved_over_reals(open_question(case, module, actuator, sensor))


def open_name(module: Module, sensor: str) -> str:
    """Return the name of the claim that a module never wins while only this sensor is missing."""
    return f"open {module.name} {sensor}"


def independent_dominators(case: Case, module: Module, sensor: str) -> tuple[str, ...]:
    """Return the modules that dominate a module somewhere and do not need `sensor`."""
    return tuple(
        name
        for name in case.network.dominators(module.name)
        if sensor not in case.contents.needs(case.wired_modules[name])
    )


class Guarded(NamedTuple):
    """A module that moves the robot, and a dominator that fails to prevent it without one of `sensors`.

    It fails by itself, silent without the sensor, or is held back by a failsafe `holder`, blind without it.
    """

    module: Module
    actuator: Actuator
    guard: AnyModule
    sensors: tuple[str, ...]
    holder: AnyModule | None = None

    def only(self, sensors: Iterable[str]) -> Self:
        """Return the same of these sensors alone."""
        return self._replace(sensors=tuple(sensors))

    def question(self, case: Case, sensor: str) -> Question:
        """Return the question if the guard alone, with the sensor, never holds the module back.

        That is, with all sensors present, and the holder not active, the module is never kept from moving the
        robot only by guards that need the sensor.
        """
        names = [x.name for x in (self.module, self.guard, self.holder) if x is not None]
        return Question(f"guarded {' '.join(names)} {sensor}", partial(self._claim, case, sensor))

    def _claim(self, case: Case, sensor: str) -> Expression:
        own = {x.name for x in (self.guard, self.holder) if x is not None}
        others = (name for name in independent_dominators(case, self.module, sensor) if name not in own)
        held_back = (
            *with_all_sensors(case),
            active(self.module.name),
            active(self.guard.name),
            *(() if self.holder is None else (negation(active(self.holder.name)),)),
            negation(won(self.actuator.name, self.module.name)),
            drives(self.module, self.actuator),
        )
        return negation(all_of((*held_back, *(negation(active(name)) for name in others))))


# --- findings --------------------------------------------------------------------------------------------

Found = dict[tuple[tuple[str, ...], str], list[str]]
"""The guards that were found to fail, by the modules that a finding is about and the sensor that is lost."""


def by_guards(found: Found) -> Iterator[tuple[tuple[str, ...], tuple[str, ...], list[str]]]:
    """Yield the modules of each finding, its guards, and all sensors that they fail without."""
    grouped: dict[tuple[tuple[str, ...], tuple[str, ...]], list[str]] = {}
    for (modules, sensor), guards in found.items():
        grouped.setdefault((modules, tuple(guards)), []).append(sensor)
    for (modules, guards_together), sensors in grouped.items():
        yield modules, guards_together, sensors


def undecided_without(
    case: Case, undecided_sensors: Mapping[str, Iterable[str]], found: Iterable[tuple[str, str]]
) -> Iterator[Diagnostic]:
    """Yield a note for each module of which it is unknown whether it can drive without a sensor.

    `undecided_sensors` are the sensors by module, `found` the pairs of module and sensor that are known.
    """
    known = set(found)
    for module, names in undecided_sensors.items():
        sensors = [s for s in dict.fromkeys(names) if (module, s) not in known]
        if sensors:
            what = f"`{module}` can drive with {quoted(sensors, 'or')} missing"
            contract = (
                f"contract still: not fresh({sensors[0]}) implies {case.modules[module].actuator} is idle"
            )
            yield undecided(case.modules[module].span, what, f"state it: `{contract}`")


def inhibitor_hint(sensors: list[str], module: str) -> str:
    """Return the advice to wire a module that inhibits while a sensor is missing."""
    present = " and ".join(f"fresh({s})" for s in sensors)
    condition = f"not {present}" if len(sensors) == 1 else f"not ({present})"
    return f"wire a module `when {condition}` that inhibits `{module}`"


# --- safeguards ----------------------------------------------------------------------------------------


def guarded_fields(
    case: Case, module: Module, guard: AnyModule, actuator: Actuator, prover: LintProver
) -> frozenset[int]:
    """Return the fields against which `guard` is a safeguard of `module`."""
    fields = [i for i in range(len(actuator.fields)) if _may_move(module, actuator, i)]
    for node in case.network.nodes_above(module.name):
        if node.relation == "inhibits" and case.network.is_under(guard.name, node.dominant):
            return frozenset(fields)
    if not isinstance(guard, Module) or guard.actuator != actuator.name:
        return frozenset()  # nothing is known of the commands of a guard in Python
    return frozenset(i for i in fields if _restrains_always(module, guard, actuator, i, prover))


def _may_move(module: Module, actuator: Actuator, i: int) -> bool:
    """Return False if a module always commands the idle value of a field."""
    assert module.command is not None
    assert actuator.idle is not None
    field = module.command.fields[i]
    return not (isinstance(field, Constant) and field.value == actuator.idle[i])


def _restrains_always(module: Module, guard: Module, actuator: Actuator, i: int, prover: LintProver) -> bool:
    """Return True if a guard restrains a field of a module's command whenever both are active."""
    name = f"restrains {module.name} {guard.name} {i}"
    restrained = partial(_restrained, module, guard, actuator, i)
    constant_answer = prover.constant(Question(f"{name} always", restrained))
    if constant_answer or (constant_answer is False and prover.were_active(module.name, guard.name)):
        return constant_answer
    both_active = all_of((active(module.name), active(guard.name)))
    return bool(prover.proved([Question(name, lambda: implies(both_active, restrained()))]))


def _restrained(module: Module, guard: Module, actuator: Actuator, i: int) -> Expression:
    """Return the condition that the guard restrains the field, if both modules are active.

    The guard's field is at idle, on the other side of it or, for a speed, nearer to it. Bools and enumerators
    have no order: their field is at idle in the guard's command if it is not in the module's. A module that
    is blind commands idle.
    """
    assert actuator.idle is not None
    kind = actuator.fields[i].type
    idle = constant(actuator.idle[i], kind)
    guard_value, module_value = (_value_while_active(m, i, idle) for m in (guard, module))
    if not isinstance(kind, Quantity):
        moves = binary(Binary.NOT_EQUAL, module_value, idle)
        return implies(moves, binary(Binary.EQUAL, guard_value, idle))
    is_speed = _is_speed(kind)
    less, more = (Binary.LESS, Binary.GREATER) if is_speed else (Binary.LESS_EQUAL, Binary.GREATER_EQUAL)
    bound = module_value if is_speed else idle
    return all_of(
        (
            implies(binary(Binary.GREATER, module_value, idle), binary(less, guard_value, bound)),
            implies(binary(Binary.LESS, module_value, idle), binary(more, guard_value, bound)),
        )
    )


def _value_while_active(module: Module, i: int, idle: Expression) -> Expression:
    """Return the value of a field of a module's command while the module is active."""
    assert module.command is not None
    field = module.command.fields[i]
    is_constant = isinstance(field, Constant) and not module.failsafe
    return field if is_constant else value_or(command_of(module, i), idle)


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
