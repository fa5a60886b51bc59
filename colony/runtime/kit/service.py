"""A server written with the kit, as a node.

It takes calls, publishes fields each frame, and carries out the commands that the program's modules win.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol, TypeVar

import msgspec

from colony.ir.types import ScalarValue
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.kit.commands import Command, CommandPerformer
from colony.runtime.kit.description import Description, FieldDescription, MethodDescription
from colony.runtime.kit.once import Report, exception_text, failure_text
from colony.runtime.protocol import calls, topics
from colony.runtime.protocol.calls import CallDispatcher, CallId, Method, NoArguments, RefusedError
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import ActuatorSpec, Deployment
from colony.runtime.protocol.messages import (
    Effect,
    Fetch,
    Message,
    Right,
    SendMessage,
    ServerFrame,
    Stopped,
    Tick,
    WakeAt,
)
from colony.runtime.servers.actuating import CommandedActuators
from colony.runtime.servers.outside_control import ActuatorState, Given, OutsideCommands

A = TypeVar("A", bound=msgspec.Struct)


def method(
    name: str,
    arguments: type[A],
    handler: Callable[[Caller, A], object],
    *,
    right: Right = "command",
    max_bytes: int = calls.MAX_ARGUMENT_BYTES,
) -> Method:
    """Return a method for a server. `handler` returns the result, or raises `RefusedError`.

    Calls with more than `max_bytes` bytes of arguments, in msgpack, are refused with the code "size".
    """

    def handle(call_id: CallId, decoded: A, now_ns: int) -> object:
        return handler(call_id.caller, decoded)

    return calls.method(name, arguments, handle, right=right, max_bytes=max_bytes)


RETRY_SAFE_NS = 50_000_000
"""Nanoseconds after which a device that could not be made safe is tried again."""


class Reads(Protocol):
    """The fields of a server, read for its frames."""

    @property
    def descriptions(self) -> tuple[FieldDescription, ...]:
        """The descriptions of the fields."""
        ...

    @property
    def failing(self) -> tuple[str, ...]:
        """One line for each problem that reading them has now."""
        ...

    @property
    def opening(self) -> bool:
        """True while the device that they are read from is being opened."""
        ...

    def read(self, now_ns: int) -> Fields:
        """Return the fields at `now_ns`; None for those without a value."""
        ...


class Service:
    """A server of methods, fields and commands. Mutable.

    An exception in a handler, field or command is reported, and the server keeps running: the call is
    refused, the field has no value, or the actuator is idle.

    Raises:
        ValueError: two commands have one name, or a method has the name of one that all servers with commands
            have.
    """

    def __init__(
        self,
        name: str,
        methods: Iterable[Method],
        fields: Reads,
        report: Report,
        *,
        commands: Iterable[Command] = (),
        deployment: Deployment | None = None,
        frames_kept: int = FRAMES_KEPT,
        is_expected: bool = False,
    ) -> None:
        """Make a server; with `is_expected`, the Clock listens to its frames, as it knows its name."""
        self.address = name
        self._is_expected = is_expected
        self._reader, commands = fields, tuple(commands)
        self._performer = CommandPerformer(name, commands, report)
        self._report = report
        reporting_methods = tuple(m._replace(handler=self._report_errors(m)) for m in methods)
        description = Description(
            server=name,
            fields=fields.descriptions,
            commands=self._performer.descriptions,
            methods=tuple(MethodDescription(name=m.name, right=m.right) for m in reporting_methods),
        )
        self._actuators: CommandedActuators[Given] | None = None
        if commands:
            outside = OutsideCommands(ActuatorState(server=name, built_in=self._performer.built_in))
            self._is_stale = outside.state.is_stale
            self._actuators = CommandedActuators(outside, self._perform, make_safe=self._performer.make_safe)
        describe = calls.method("describe", NoArguments, lambda *_: description, right="read")
        self._publisher = Publisher(name, self._read, frames_kept=frames_kept, stopped=self._stopped)
        self._calls = self._dispatcher((*reporting_methods, describe))
        self._now_ns = 0
        self._retry_due_ns: int | None = None
        listens = [*self._calls.listens]
        if fields.descriptions or commands:
            listens += self._publisher.listens
        if self._actuators is not None:
            listens += self._actuators.listens
        self.listens = tuple(listens)
        if deployment is not None and self._actuators is not None:
            self._actuators.activate(deployment, 0)

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Make the devices of the commands safe until a program commands them."""
        self._now_ns = now_ns
        if self._actuators is not None:
            self._actuators.start(now_ns)
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Publish the fields on a tick or a fetch, answer calls, and carry out commands."""
        self._now_ns = now_ns
        if self._actuators is not None:
            yield from self._actuators.handle(message, now_ns, self._publish, self._calls)
        elif isinstance(message, Tick | Fetch):
            yield from self._publish(message)
        else:
            yield from self._calls.handle(message, now_ns)
        if isinstance(message, Tick):
            self._performer.end_frame()
        if self._retry_due_ns is not None and now_ns >= self._retry_due_ns:
            self._retry_due_ns = None
            self._performer.retry()
        if self._retry_due_ns is None and not self._performer.is_safe:
            self._retry_due_ns = now_ns + RETRY_SAFE_NS
            yield WakeAt(self._retry_due_ns)
        yield from self._calls.answer_stops(now_ns)

    def close(self) -> None:
        """Give the actuators their idle commands, and make the devices of the others safe."""
        if self._actuators is not None:
            self._actuators.close(self._now_ns)

    def _dispatcher(self, methods: tuple[Method, ...]) -> CallDispatcher:
        actuators, options = self._actuators, dict[str, Any]()
        if actuators is not None:
            reserved = {m.name for m in actuators.methods}
            taken = sorted(reserved.intersection(m.name for m in methods))
            if taken:
                names = ", ".join(f"`{name}`" for name in taken)
                found = f"{self.address}: found the methods {names}"
                raise ValueError(f"{found}, which servers with commands have")
            methods += actuators.methods
            options = {
                "on_lost": actuators.on_lost,
                "stop": actuators.stop,
                "unreached": lambda: self._performer.unreached,
            }
        return CallDispatcher(
            self.address,
            methods,
            other_limit_messages=lambda: self._publisher.limit_messages,
            failing=self._failing,
            opening=lambda: self._reader.opening,
            **options,
        )

    def _failing(self) -> tuple[str, ...]:
        return (*self._reader.failing, *self._performer.failing)

    def _report_errors(self, method: Method) -> calls.Handler:
        """Return the method's handler, with its exceptions reported and turned into refusals."""

        def handle(call_id: CallId, arguments: Any, now_ns: int) -> object:
            try:
                return method.handler(call_id, arguments, now_ns)
            except RefusedError:
                raise
            except Exception as problem:
                where = f"{self.address}.{method.name}"
                self._report(failure_text(where, problem))
                raise RefusedError(
                    "failed", f"{where} failed: {type(problem).__name__}: {exception_text(problem)}"
                ) from None

        return handle

    # --- frames --------------------------------------------------------------------------------------

    def _publish(self, message: Tick | Fetch) -> Iterator[Effect]:
        """Publish a frame; also to the Clock, without fields, unless it listens to the server's frames."""
        for effect in self._publisher.handle(message):
            yield effect
            if self._is_expected:
                continue
            if isinstance(effect, SendMessage) and isinstance(effect.message, ServerFrame):
                yield SendMessage(topics.ANSWERS, msgspec.structs.replace(effect.message, fields={}))

    def _read(self, tick: Tick) -> Fields:
        fields = self._reader.read(self._now_ns)
        return fields if self._actuators is None else {**fields, **self._actuators.fields(tick)}

    def _stopped(self) -> Stopped | None:
        return None if self._actuators is None else self._actuators.stopped

    def _perform(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        self._performer.perform(actuator, values, stale=self._is_stale(now_ns))
