"""Commands of connections to the actuators of a server that has no motions of its own.

A connection commands by the name of the server's command, with the values of its parameters. In frames of a
program, these are values of the actuator that the program binds to that command; without one, of the server's
built-in actuator.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from colony.ir.types import ScalarValue
from colony.runtime.arbitration.outside import Commander, lease_end
from colony.runtime.library import actuator
from colony.runtime.protocol.calls import CallId, Method, RefusedError, method
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec
from colony.runtime.servers.built_in import expected_of
from colony.runtime.servers.outside_control import OutsideControl, Proposal

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
    """The commands of connections to a server's actuators. Mutable."""

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods that command, and those of every server with actuators."""
        return (method("command", actuator.Command, self._command), *super().methods)

    def report(self, now_ns: int) -> tuple[actuator.OutsideReport, ...]:
        """Return the connections that have commanded, and their current commands."""
        return tuple(
            actuator.OutsideReport(command=name, values=None if given is None else dict(given), **common)
            for name, given, common in self._reported(now_ns)
        )

    def _propose(
        self, spec: ActuatorSpec, commander: Commander[Given], may_act: bool, now_ns: int
    ) -> Proposal | None:
        assert commander.command is not None
        values = fitted(self._target(spec), commander.command)
        if values is None:  # another program runs, whose actuator does not take this command
            commander.end()
            return None
        return Proposal(values)

    def _target(self, spec: ActuatorSpec) -> Target:
        built_in = self.state.built_in.get(spec.command)
        named = spec if built_in is None else built_in
        names = tuple(field.name for field in named.fields)
        return Target(spec, names, tuple(range(len(names))) if built_in is None else spec.field_indices)

    def _command(self, call_id: CallId, arguments: actuator.Command, now_ns: int) -> None:
        server, actuators = self.state.server, self.state.actuators
        spec = actuators.get(arguments.command)
        if spec is None:
            found = f"{server} has no command `{arguments.command}`"
            expected = f"it has {', '.join(actuators)}" if actuators else "it has none now"
            raise RefusedError("arguments", f"{found}; {expected}")
        problem = mismatch(self._target(spec), arguments.values)
        if problem is not None:
            raise RefusedError("arguments", f"{server}.{arguments.command}: {problem}")
        lease_end_ns = lease_end(arguments.lease_s, now_ns)
        commander = self.admit_while_ticking(call_id.caller, self.contest(spec), now_ns)
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
        elif (expected := expected_of(field, value)) is not None:
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
        if expected_of(field, value) is not None:
            return None
        values[index] = value
    return tuple(values)


def _within(field: ActuatorFieldSpec, value: float) -> float:
    if field.low is not None and value < field.low:
        return field.low
    return field.high if field.high is not None and value > field.high else value
