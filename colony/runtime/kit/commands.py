"""Commands of a server written with the kit: what is declared of them, and how they are carried out.

    lift = Lift("/dev/ttyACM0")
    command("move", lift.move, parameter("height", unit="mm", low=0.0, high=400.0), safe=lift.stop)

A behavior binds an actuator to it, `actuator lift { height : mm range 0 .. 400 } to Lift.move`, and its
modules are arbitrated as those of any other actuator. `lift.move(height=...)` is called once in each frame.

The safe state of an actuator is its idle command, which the behavior declares. An actuator on `idle hold` has
none: its device is put into a safe state by the function `safe` of its command.
"""

from __future__ import annotations

import inspect
import math
import reprlib
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

from colony.ir.types import ScalarValue
from colony.runtime.kit.description import CommandDescription, ParameterDescription, parameter_type
from colony.runtime.kit.fields import Report, exception_text
from colony.runtime.protocol.deployment import ActuatorSpec, Deployment, actuators_of
from colony.runtime.servers.commanding import NotSentError


class Command(NamedTuple):
    """A command: its description, the function that performs it, and the one that makes its device safe."""

    description: CommandDescription
    perform: Callable[..., object]
    safe: Callable[[], object] | None


def command(
    name: str,
    perform: Callable[..., object],
    *parameters: ParameterDescription,
    safe: Callable[[], object] | None = None,
) -> Command:
    """Return a command for a server.

    Args:
        name: the name of the command.
        perform: called with the parameters by keyword, once in each frame that decides for a command; it must
            not block. An exception is reported, and the actuator becomes idle for that frame.
        parameters: the parameters.
        safe: called without arguments when the server starts; and at an emergency stop, when no more ticks
            arrive and when the server ends, unless an idle command is performed then.

    Raises:
        ValueError: two parameters have one name, `perform` does not take them, or a function would do nothing
            when it is called: a coroutine or generator function.
    """
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise ValueError(f"{name}: found the parameters {', '.join(names)}; expected each once")
    _check_runs(name, "perform", perform)
    _check_runs(name, "safe", safe)
    _check_takes(name, perform, names)
    return Command(CommandDescription(name=name, parameters=parameters), perform, safe)


def parameter(
    name: str,
    *,
    unit: str = "",
    boolean: bool = False,
    members: Mapping[str, float] | None = None,
    low: float | None = None,
    high: float | None = None,
    meaning: str = "",
) -> ParameterDescription:
    """Return a parameter of a command: a number, a bool, or a member of an enum, by its number.

    Args:
        name: the name of the parameter, by which it is passed.
        unit: the base unit of the number (mm, s, deg, A, V, degC); "" for a plain number.
        boolean: True for a bool.
        members: the members of an enum with their numbers; the enum of a behavior must have the same.
        low: the least number, in the unit.
        high: the greatest number, in the unit.
        meaning: a description for users.

    Raises:
        ValueError: the name cannot be passed by keyword, the unit is not a base unit, or the bounds or
            members are invalid.
    """
    if not name.isidentifier():
        raise ValueError(f"found the parameter {name!r}; expected a name of letters, digits and `_`")
    bounds = [bound for bound in (low, high) if bound is not None]
    if (boolean or members is not None) and (unit or bounds or (boolean and members is not None)):
        raise ValueError(f"{name}: found several kinds; expected a number, a bool or members")
    if not all(map(math.isfinite, bounds)) or (len(bounds) == 2 and bounds[0] > bounds[1]):
        raise ValueError(f"{name}: found the bounds {low} and {high}; expected finite ones in order")
    if members is not None and not (members and all(map(math.isfinite, members.values()))):
        raise ValueError(
            f"{name}: found the members {dict(members)}; expected one or more, with finite numbers"
        )
    description = ParameterDescription(
        name=name,
        kind="bool" if boolean else "number" if members is None else "enum",
        unit=unit,
        low=low,
        high=high,
        members={} if members is None else {member: float(number) for member, number in members.items()},
        meaning=meaning,
    )
    parameter_type(description)
    return description


def _check_runs(name: str, what: str, function: Callable[..., object] | None) -> None:
    kinds = (inspect.iscoroutinefunction, inspect.isgeneratorfunction, inspect.isasyncgenfunction)
    if any(is_kind(function) for is_kind in kinds):
        raise ValueError(f"{name}: `{what}` does nothing when it is called; expected a plain function")


def _check_takes(name: str, perform: Callable[..., object], parameters: list[str]) -> None:
    try:
        signature = inspect.signature(perform)
    except (TypeError, ValueError):
        return  # a function of another language, which does not say what it takes
    try:
        signature.bind(**dict.fromkeys(parameters))
    except TypeError as problem:
        raise ValueError(f"{name}: `perform` cannot be called with its parameters: {problem}") from None


class CommandPerformer:
    """Carries out the commands of a server. Mutable: knows the actuators, and the problems it has reported.

    No exception of a command ends the server. Each kind of problem of a command is reported once.

    Raises:
        ValueError: two commands have one name.
    """

    def __init__(self, server: str, commands: Iterable[Command], report: Report) -> None:
        self._server = server
        self._commands: dict[str, Command] = {}
        for command in commands:
            if self._commands.setdefault(command.description.name, command) is not command:
                raise ValueError(f"{server}: found two commands `{command.description.name}`")
        self._report = report
        self._reported: set[tuple[str, str]] = set()
        self._actuators: dict[str, ActuatorSpec] = {}

    @property
    def descriptions(self) -> tuple[CommandDescription, ...]:
        """The descriptions of the commands."""
        return tuple(command.description for command in self._commands.values())

    def begin(self, deployed: Deployment) -> None:
        """Perform the commands of this program from now on."""
        self._actuators = {spec.command: spec for spec in actuators_of(deployed, self._server)}

    def mismatch(self, deployed: Deployment) -> str | None:
        """Return the reason why a deployment does not fit the commands, or None."""
        return next(self._mismatches(actuators_of(deployed, self._server)), None)

    def perform(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...], *, stale: bool) -> None:
        """Perform a command, in base units; with `stale`, only the idle command.

        Raises:
            NotSentError: the command was not performed; the actuator is idle or safe instead, if possible.
        """
        is_idle = values == actuator.idle
        if stale and not is_idle:
            raise NotSentError("no command was sent, as the tick came too late", instead=self._idle(actuator))
        problem = self._try(actuator, values)
        if problem is None:
            return
        if is_idle:
            self._make_safe(actuator.command)
            raise NotSentError(problem)
        raise NotSentError(problem, instead=self._idle(actuator))

    def halt(self) -> None:
        """Make the devices safe whose actuators have no idle command, or that no program commands."""
        for name in self._commands:
            if (actuator := self._actuators.get(name)) is None or actuator.idle is None:
                self._make_safe(name)

    def _idle(self, actuator: ActuatorSpec) -> tuple[ScalarValue, ...] | None:
        """Perform the idle command and return it; where there is none or it fails, make the device safe."""
        if actuator.idle is not None and self._try(actuator, actuator.idle) is None:
            return actuator.idle
        self._make_safe(actuator.command)
        return None

    def _try(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...]) -> str | None:
        """Perform a command; return the problem if it fails, after reporting it."""
        command, where = self._commands[actuator.command], f"{self._server}.{actuator.command}"
        arguments: dict[str, ScalarValue] = {}
        parameters = command.description.parameters
        for parameter, index in zip(parameters, actuator.field_indices, strict=True):
            value = _absent(parameter) if index is None else values[index]
            if (expected := _unacceptable(parameter, value)) is not None:
                problem = f"{where} was not sent {parameter.name} = {value:g}: expected {expected}"
                self._report_once(actuator.command, parameter.name, problem)
                return problem
            arguments[parameter.name] = value
        try:
            command.perform(**arguments)
        except Exception as failure:
            self._report_failure(actuator.command, "", failure)
            return f"{where} failed: {type(failure).__name__}: {reprlib.repr(exception_text(failure))}"
        return None

    def _make_safe(self, name: str) -> None:
        safe = self._commands[name].safe
        if safe is None:
            return
        try:
            safe()
        except Exception as failure:
            self._report_failure(name, "safe of ", failure)

    def _report_failure(self, name: str, what: str, failure: Exception) -> None:
        problem = f"{what}{self._server}.{name} failed:\n{traceback.format_exc()}"
        self._report_once(name, f"{what}{type(failure).__name__}", problem)

    def _report_once(self, name: str, kind: str, problem: str) -> None:
        if (name, kind) not in self._reported:
            self._reported.add((name, kind))
            self._report(problem)

    # --- deployments ---------------------------------------------------------------------------------

    def _mismatches(self, actuators: tuple[ActuatorSpec, ...]) -> Iterator[str]:
        names: dict[str, str] = {}
        for actuator in actuators:
            command = self._commands.get(actuator.command)
            if command is None:
                yield f"`{actuator.name}`: {self._server} has no command `{actuator.command}`"
                continue
            first = names.setdefault(actuator.command, actuator.name)
            if first != actuator.name:
                yield f"`{first}` and `{actuator.name}` command {self._server}.{actuator.command}"
            yield from _mismatches(actuator, command.description)


def _mismatches(actuator: ActuatorSpec, command: CommandDescription) -> Iterator[str]:
    count, parameters = len(actuator.fields), command.parameters
    if len(actuator.field_indices) != len(parameters):
        yield f"`{actuator.name}`: {len(actuator.field_indices)} parameters; expected {len(parameters)}"
        return
    for parameter, index in zip(parameters, actuator.field_indices, strict=True):
        if index is None:
            continue
        if not 0 <= index < count:
            yield f"`{actuator.name}`: `{parameter.name}` is not one of its {count} fields"
            return
        if (actuator.fields[index].kind == "bool") != (parameter.kind == "bool"):
            yield f"`{actuator.name}`: `{parameter.name}` is a {actuator.fields[index].kind}"
    if any(not math.isfinite(field.factor) or field.factor == 0.0 for field in actuator.fields):
        yield f"`{actuator.name}`: a factor is 0 or not finite"
    for parameter, index in zip(parameters, actuator.field_indices, strict=True):
        if actuator.idle is None and index is not None:
            continue
        value = _absent(parameter) if index is None or actuator.idle is None else actuator.idle[index]
        if (expected := _unacceptable(parameter, value)) is not None:
            yield f"`{actuator.name}`: {parameter.name} = {value!r} when idle; expected {expected}"
    priorities = [priority for _, priority in actuator.clients]
    if priorities != sorted(priorities, reverse=True):
        yield f"`{actuator.name}`: the clients are not in the order of their priorities"


def _absent(parameter: ParameterDescription) -> ScalarValue:
    """Return the value of a parameter that an actuator does not declare."""
    return False if parameter.kind == "bool" else 0.0


def _unacceptable(parameter: ParameterDescription, value: ScalarValue) -> str | None:
    """Return what was expected in place of a value, or None if a parameter may have it."""
    if parameter.kind == "bool":
        return None if isinstance(value, bool) else "a bool"
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return "a finite number"
    if parameter.kind == "enum":
        return None if value in parameter.members.values() else "the number of a member"
    low, high = parameter.low, parameter.high
    if (low is not None and value < low) or (high is not None and value > high):
        return f"{'any' if low is None else f'{low:g}'} to {'any' if high is None else f'{high:g}'}"
    return None
