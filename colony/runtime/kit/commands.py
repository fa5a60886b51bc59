"""Commands of a server written with the kit: what is declared of them, and how they are carried out.

    lift = Lift("/dev/ttyACM0")
    command("move", lift.move, parameter("height", unit="mm", low=0.0, high=400.0), safe=lift.stop)

A behavior binds an actuator to it, `actuator lift { height : mm range 0 .. 400 } to Lift.move`, and its
modules are arbitrated as those of any other actuator. `lift.move(height=...)` is called once in each frame.

The safe state of an actuator is its idle command, which the behavior declares. An actuator on `idle hold` has
none: its device is put into a safe state by the function `safe` of its command. Connections may command, too,
`connection.do(actuator.command("move", {"height": 200.0}))`: also without a program.
"""

from __future__ import annotations

import inspect
import math
import reprlib
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from colony.execute.intake import as_float
from colony.ir.types import ScalarValue
from colony.runtime.kit.description import (
    CommandDescription,
    Description,
    ParameterDescription,
    in_base_units,
    parameter_type,
    server_spec,
)
from colony.runtime.kit.once import OnceReporter, Report, exception_text, failure_text, headline
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.servers.commanding import NotSentError, absent, built_in_actuator, expected_of


class Parameter(NamedTuple):
    """A parameter: its description, in a base unit, and the factor to it from the unit of `perform`."""

    description: ParameterDescription
    factor: float = 1.0


class Command(NamedTuple):
    """A command: its description, the function that performs it, and the one that makes its device safe.

    `unreached` returns why the device has not been reached by either, or not yet, although they returned. An
    OSError of either is not reported while `is_explained` is true: its device is being opened, or its driver
    says itself why the device does not work.
    """

    description: CommandDescription
    perform: Callable[..., object]
    safe: Callable[[], object] | None
    unreached: Callable[[], tuple[str, ...]] = tuple
    is_explained: Callable[[], bool] = bool


def command(
    name: str,
    perform: Callable[..., object],
    *parameters: Parameter,
    safe: Callable[[], object] | None = None,
) -> Command:
    """Return a command for a server.

    Args:
        name: the name of the command.
        perform: called with the parameters by keyword, in their units, once in each frame that decides for a
            command; it must not block. An exception is reported, and the actuator becomes idle for that
            frame.
        parameters: the parameters.
        safe: called without arguments when the server starts; and at an emergency stop, when no more ticks
            arrive, when the command of a connection has ended, and when the server ends, unless an idle
            command is performed then.

    Raises:
        ValueError: two parameters have one name, `perform` does not take them, or a function would do nothing
            when it is called: a coroutine or generator function.
    """
    names = [parameter.description.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise ValueError(f"{name}: found the parameters {', '.join(names)}; expected each once")
    _check_runs(name, "perform", perform)
    _check_runs(name, "safe", safe)
    _check_takes(name, perform, names)
    description = CommandDescription(name=name, parameters=tuple(p.description for p in parameters))
    factors = {parameter.description.name: parameter.factor for parameter in parameters}
    return Command(description, in_units(perform, factors), safe)


def in_units(perform: Callable[..., object], factors: Mapping[str, float]) -> Callable[..., object]:
    """Return a function that takes parameters in base units, and calls `perform` with them in its units.

    Args:
        perform: takes the parameters by keyword.
        factors: the units of `perform`, in base units, for each parameter.
    """

    def convert(**values: ScalarValue) -> object:
        return perform(**{n: x if isinstance(x, bool) else x / factors[n] for n, x in values.items()})

    return convert


def parameter(
    name: str,
    *,
    unit: str = "",
    boolean: bool = False,
    members: Mapping[str, float] | None = None,
    low: float | None = None,
    high: float | None = None,
    meaning: str = "",
) -> Parameter:
    """Return a parameter of a command: a number, a bool, or a member of an enum, by its number.

    Args:
        name: the name of the parameter, by which it is passed.
        unit: the unit in which `perform` takes the number, such as "kg" or "percent"; "" for a plain number.
        boolean: True for a bool.
        members: the members of an enum with their numbers; the enum of a behavior must have the same.
        low: the least number, in the unit.
        high: the greatest number, in the unit.
        meaning: a description for users.

    Raises:
        ValueError: the name cannot be passed by keyword, the unit is invalid, or the bounds or
            members are invalid.
    """
    if not isinstance(name, str) or not name.isidentifier():
        raise ValueError(f"found the parameter {name!r}; expected a name of letters, digits and `_`")
    bounds = [bound for bound in (low, high) if bound is not None]
    if (boolean or members is not None) and (unit or bounds or (boolean and members is not None)):
        raise ValueError(f"{name}: found several kinds; expected a number, a bool or members")
    base_unit, factor = in_base_units(unit)
    if not all(_is_finite(bound, factor) for bound in bounds) or (len(bounds) == 2 and bounds[0] > bounds[1]):
        raise ValueError(
            f"{name}: found the bounds {low!r} and {high!r}; expected finite numbers, the lower one first"
        )
    if members is not None and not (members and all(map(_is_finite, members.values()))):
        raise ValueError(
            f"{name}: found the members {dict(members)}; expected one or more, with finite numbers"
        )
    description = ParameterDescription(
        name=name,
        kind="bool" if boolean else "number" if members is None else "enum",
        unit=base_unit,
        low=None if low is None else low * factor,
        high=None if high is None else high * factor,
        members={} if members is None else {member: float(number) for member, number in members.items()},
        meaning=meaning,
    )
    parameter_type(description)
    return Parameter(description, factor)


def _is_finite(number: object, factor: float = 1.0) -> bool:
    found = as_float(number)
    return found is not None and math.isfinite(found * factor)


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


_SAFE_OF = "safe of "
"""Begin of the name of a command's function `safe`, in reports."""


class CommandPerformer:
    """Carries out the commands of a server. Mutable: knows the problems that it has reported.

    `built_in` are the server's own actuators, by command.

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
        description = Description(server=server, commands=self.descriptions)
        self.built_in = {
            spec.name: built_in_actuator(server, spec, idle=None)
            for spec in server_spec(description).commands
        }
        self._problems = OnceReporter(report)
        self._unsafe: set[str] = set()
        self._unstopped: dict[str, str] = {}  # why the devices of commands are neither idle nor safe

    @property
    def failing(self) -> tuple[str, ...]:
        """One line for each command that fails."""
        return self._problems.failing

    def end_frame(self) -> None:
        """End a frame, in which each actuator had a command."""
        self._problems.end_frame()

    @property
    def descriptions(self) -> tuple[CommandDescription, ...]:
        """The descriptions of the commands."""
        return tuple(command.description for command in self._commands.values())

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
            self.make_safe(actuator.command)
            raise NotSentError(problem)
        raise NotSentError(problem, instead=self._idle(actuator))

    def make_safe(self, name: str) -> None:
        """Make the device of a command safe, if the command says how; if that fails, `retry` tries again."""
        safe = self._commands[name].safe
        if safe is None:
            return
        self._unsafe.add(name)
        try:
            safe()
        except (Exception, SystemExit) as failure:
            self._report_failure(name, _SAFE_OF, failure)
        else:
            self._note_safe(name)

    @property
    def is_safe(self) -> bool:
        """True unless a device could not be made safe, and has performed no command since."""
        return not self._unsafe

    @property
    def unreached(self) -> tuple[str, ...]:
        """One line for each device that is neither idle nor safe after a stop, or not yet."""
        waiting = (line for command in self._commands.values() for line in command.unreached())
        return tuple(dict.fromkeys((*self._unstopped.values(), *waiting)))

    def retry(self) -> None:
        """Try again to make the devices safe that could not be made safe."""
        for name in tuple(self._unsafe):
            self.make_safe(name)

    def _idle(self, actuator: ActuatorSpec) -> tuple[ScalarValue, ...] | None:
        """Perform the idle command and return it; where there is none or it fails, make the device safe."""
        if actuator.idle is not None and self._try(actuator, actuator.idle) is None:
            return actuator.idle
        self.make_safe(actuator.command)
        return None

    def _try(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...]) -> str | None:
        """Perform a command; return the problem if it fails, after reporting it."""
        command, where = self._commands[actuator.command], f"{self._server}.{actuator.command}"
        arguments: dict[str, ScalarValue] = {}
        parameters = self.built_in[actuator.command].fields
        for parameter, index in zip(parameters, actuator.field_indices, strict=True):
            value = absent(parameter) if index is None else values[index]
            if (expected := expected_of(parameter, value)) is not None:
                problem = f"{where} was not sent {parameter.name} = {value:g}: expected {expected}"
                self._problems.report(actuator.command, parameter.name, problem)
                return problem
            arguments[parameter.name] = value
        try:
            command.perform(**arguments)
        except (Exception, SystemExit) as failure:
            self._report_failure(actuator.command, "", failure)
            return f"{where} failed: {type(failure).__name__}: {reprlib.repr(exception_text(failure))}"
        self._note_safe(actuator.command)
        return None

    def _note_safe(self, name: str) -> None:
        self._unsafe.discard(name)
        self._unstopped.pop(name, None)
        self._problems.note_success(f"{_SAFE_OF}{name}")

    def _report_failure(self, name: str, what: str, failure: BaseException) -> None:
        problem = failure_text(f"{what}{self._server}.{name}", failure)
        self._unstopped[name] = headline(problem)
        if isinstance(failure, OSError) and self._commands[name].is_explained():
            return
        self._problems.report(f"{what}{name}", type(failure).__name__, problem)
