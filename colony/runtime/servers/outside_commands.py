"""Commands of connections to the actuators of a server that has no motions of its own.

A connection commands by the name of the server's command, with the values of its parameters. In frames of a
program, these are values of the actuator that the program binds to that command; without one, of the server's
built-in actuator.
"""

from __future__ import annotations

from collections.abc import Mapping

from colony.ir.types import ScalarValue
from colony.runtime.arbitration.outside import Commander, lease_end
from colony.runtime.library import actuator
from colony.runtime.protocol.calls import CallId, Method, RefusedError, method
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec
from colony.runtime.servers.built_in import absent, expected_of
from colony.runtime.servers.outside_control import OutsideControl, Proposal

Given = Mapping[str, ScalarValue]
"""The values of a command's parameters, in base units."""

Indices = Mapping[str, int | None]
"""The index of the actuator's field for each parameter of a command; None for no field."""


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
        values = fitted(spec, self._indices(spec), commander.command)
        if values is None:  # another program runs, whose actuator does not take this command
            commander.end()
            return None
        return Proposal(values)

    def _indices(self, spec: ActuatorSpec) -> Indices:
        built_in = self.state.built_in.get(spec.command)
        if built_in is None:
            return {field.name: i for i, field in enumerate(spec.fields)}
        names = (field.name for field in built_in.fields)
        return dict(zip(names, spec.field_indices, strict=True))

    def _command(self, call_id: CallId, arguments: actuator.Command, now_ns: int) -> None:
        server, actuators = self.state.server, self.state.actuators
        spec = actuators.get(arguments.command)
        if spec is None:
            found = f"{server} has no command `{arguments.command}`"
            expected = f"it has {', '.join(actuators)}" if actuators else "it has none now"
            raise RefusedError("arguments", f"{found}; {expected}")
        problem = mismatch(spec, self._indices(spec), arguments.values)
        if problem is not None:
            raise RefusedError("arguments", f"{server}.{arguments.command}: {problem}")
        lease_end_ns = lease_end(arguments.lease_s, now_ns)
        commander = self.admit_while_ticking(call_id.caller, self.contest(spec), now_ns)
        self.begin(commander, arguments.values, lease_end_ns=lease_end_ns)


# --- values ----------------------------------------------------------------------------------------


def mismatch(spec: ActuatorSpec, indices: Indices, given: Given) -> str | None:
    """Return the reason why these values are no command of an actuator, or None if they are one."""
    for name in given:
        if name not in indices:
            return f"found `{name}`; its parameters are {', '.join(indices)}"
    for name, index in indices.items():
        value = given.get(name)
        if index is None:
            if value:
                return f"{name} = {value!r}, but the actuator `{spec.name}` has no such field"
        elif value is None:
            return f"{name} is missing"
        elif (expected := expected_of(spec.fields[index], value)) is not None:
            return f"{name} = {value!r}; expected {expected}"
    return None


def fitted(spec: ActuatorSpec, indices: Indices, given: Given) -> tuple[ScalarValue, ...] | None:
    """Return the values of an actuator's fields, within their ranges; None if they are not of its kinds."""
    values = [absent(field) for field in spec.fields]
    for name, index in indices.items():
        value = given.get(name)
        if index is None:
            if value:
                return None
            continue
        field = spec.fields[index]
        if field.kind == "number" and value is not None and not isinstance(value, bool):
            value = _within(field, float(value))
        if value is None or expected_of(field, value) is not None:
            return None
        values[index] = value
    return tuple(values)


def _within(field: ActuatorFieldSpec, value: float) -> float:
    if field.low is not None and value < field.low:
        return field.low
    return field.high if field.high is not None and value > field.high else value
