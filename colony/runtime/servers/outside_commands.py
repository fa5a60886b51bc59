"""Commands of connections to the actuators of a server that has no motions of its own.

A connection commands by the name of the server's command, with the values of its parameters. In frames of a
program, these are values of the actuator that the program binds to that command; without one, of the server's
built-in actuator. All actuators of a server share its lock; priorities and leases are those of each actuator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from colony.ir.types import ScalarValue
from colony.runtime.arbitration.ballot import NO_INTERVENTIONS, STOPPED, Interventions, OutsideCommand
from colony.runtime.arbitration.outside import OutsideCommanders, lease_end
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.library import actuator
from colony.runtime.protocol.calls import CallId, Method, RefusedError, method
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec
from colony.runtime.servers.command_values import expected_instead
from colony.runtime.servers.outside_control import Contest, OutsideControl

Given = Mapping[str, ScalarValue]
"""The values of a command's parameters, in base units."""


class Target(NamedTuple):
    """The actuator that a command of the server has now.

    `parameters` are those of the command, and `indices` the indices of their fields, None for no field.
    """

    spec: ActuatorSpec
    parameters: tuple[str, ...]
    indices: tuple[int | None, ...]

    def fields(self) -> Iterable[tuple[str, ActuatorFieldSpec | None, int]]:
        """Yield each parameter with its field and the field's index; None and -1 if it has none."""
        for name, index in zip(self.parameters, self.indices, strict=True):
            yield (name, None, -1) if index is None else (name, self.spec.fields[index], index)


class OutsideCommands(OutsideControl[Given]):
    """The commands of connections to a server's actuators. Mutable.

    Args:
        server: the name of the server.
        targets: function that returns the actuators that can be commanded now, by command.
        emergency: the emergency stop of the server.
        is_ticking: function that returns True if the Clock is ticking at a given time.
    """

    def __init__(
        self,
        server: str,
        targets: Callable[[], Mapping[str, Target]],
        emergency: StopFollower,
        is_ticking: Callable[[int], bool],
    ) -> None:
        super().__init__(self._all_contests, emergency, is_ticking, server)
        self._targets = targets
        self._commanders: dict[str, OutsideCommanders[Given]] = {}

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods that command, and those of every server with actuators."""
        return (method("command", actuator.Command, self._command), *super().methods)

    def contest(self, spec: ActuatorSpec) -> Contest[Given]:
        """Return the parties that compete for an actuator."""
        commanders = self._commanders.setdefault(spec.command, OutsideCommanders())
        return Contest(commanders, {priority: client for client, priority in spec.clients})

    def find_tie(self, specs: Iterable[ActuatorSpec]) -> str | None:
        """Return a conflict between the priorities of a program and those of connections, or None."""
        contests = map(self.contest, specs)
        ties = (contest.commanders.find_tie(contest.clients) for contest in contests)
        return next((tie for tie in ties if tie is not None), None)

    def interventions(self, command: str, target_of: Callable[[], Target], now_ns: int) -> Interventions:
        """Return the outside commands for the actuator of a command, and the stop or lock in force.

        `target_of` returns that actuator; it is called only if a connection commands it.
        """
        if self._emergency.stopped is not None:
            return STOPPED
        holder, commanders = self.lock.holder, self._commanders.get(command)
        if commanders is None or not commanders.all:
            return NO_INTERVENTIONS if holder is None else Interventions((), "locked", holder.connection)
        commanders.expire(now_ns)
        commands, target = [], target_of()
        for commander in commanders.commanding:
            assert commander.command is not None
            values = fitted(target, commander.command)
            if values is None:  # another program runs, whose actuator does not take this command
                commander.end()
                continue
            caller = commander.caller
            commands.append(
                OutsideCommand(caller.connection, caller.priority, values, unlimited=commander.unlimited)
            )
        if holder is None:
            return Interventions(tuple(commands))
        return Interventions(tuple(commands), "locked", holder.connection)

    def report(self, now_ns: int) -> tuple[actuator.OutsideReport, ...]:
        """Return the connections that have commanded, and their current commands."""
        return tuple(
            actuator.OutsideReport(
                connection=commander.caller.connection,
                name=commander.caller.name,
                priority=commander.caller.priority,
                command=command,
                values=None if commander.command is None else dict(commander.command),
                lease_s=None if commander.lease_end_ns is None else (commander.lease_end_ns - now_ns) / 1e9,
                unlimited=commander.unlimited,
            )
            for command, commanders in self._commanders.items()
            for commander in commanders.all
        )

    def _all_contests(self) -> Iterable[Contest[Given]]:
        """Return the contests of all actuators, and of those that connections commanded in earlier runs."""
        now = {name: self.contest(target.spec) for name, target in self._targets().items()}
        before = {name: Contest[Given](c, {}) for name, c in self._commanders.items() if name not in now}
        return (*now.values(), *before.values())

    def _command(self, call_id: CallId, arguments: actuator.Command, now_ns: int) -> None:
        targets = self._targets()
        target = targets.get(arguments.command)
        if target is None:
            found = f"{self._server} has no command `{arguments.command}`"
            expected = f"it has {', '.join(targets)}" if targets else "it has none now"
            raise RefusedError("arguments", f"{found}; {expected}")
        problem = mismatch(target, arguments.values)
        if problem is not None:
            raise RefusedError("arguments", f"{self._server}.{arguments.command}: {problem}")
        lease_end_ns = lease_end(arguments.lease_s, now_ns)
        commander = self.admit_while_ticking(call_id.caller, self.contest(target.spec), now_ns)
        self.begin(commander, arguments.values, lease_end_ns=lease_end_ns)


# --- values ----------------------------------------------------------------------------------------


def mismatch(target: Target, given: Given) -> str | None:
    """Return the reason why these values are no command of an actuator, or None if they are one."""
    for name in given:
        if name not in target.parameters:
            return f"found `{name}`; its parameters are {', '.join(target.parameters)}"
    for name, field, _ in target.fields():
        value = given.get(name)
        if field is None:
            if value:
                return f"{name} = {value!r}, but the actuator `{target.spec.name}` has no such field"
        elif value is None:
            return f"{name} is missing"
        elif (expected := _expected(field, value)) is not None:
            return f"{name} = {value!r}; expected {expected}"
    return None


def fitted(target: Target, given: Given) -> tuple[ScalarValue, ...] | None:
    """Return the values of an actuator's fields, within their ranges; None if they are not of its kinds."""
    values: list[ScalarValue] = [False if f.kind == "bool" else 0.0 for f in target.spec.fields]
    for name, field, index in target.fields():
        value = given.get(name)
        if field is None:
            if value:
                return None
            continue
        if value is None:
            return None
        if field.kind == "number" and not isinstance(value, bool):
            value = _within(field, float(value))
        if _expected(field, value) is not None:
            return None
        values[index] = value
    return tuple(values)


def _expected(field: ActuatorFieldSpec, value: ScalarValue) -> str | None:
    return expected_instead(
        value, is_bool=field.kind == "bool", members=field.members, low=field.low, high=field.high
    )


def _within(field: ActuatorFieldSpec, value: float) -> float:
    if field.low is not None and value < field.low:
        return field.low
    return field.high if field.high is not None and value > field.high else value
