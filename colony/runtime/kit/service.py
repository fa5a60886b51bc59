"""A server written with the kit, as a node: it takes calls, and publishes fields each frame."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, TypeVar

import msgspec

from colony.ir.types import Value
from colony.runtime.frames.publishing import Fields, Publisher
from colony.runtime.kit.description import Description, FieldDescription, MethodDescription, field_type
from colony.runtime.protocol import calls, topics
from colony.runtime.protocol.calls import CallDispatcher, CallId, Method, NoArguments, RefusedError
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.messages import (
    Effect,
    Fetch,
    Message,
    QuietNode,
    Right,
    Sample,
    Send,
    ServerFrame,
    Tick,
)

A = TypeVar("A", bound=msgspec.Struct)

Report = Callable[[str], None]


class Field(NamedTuple):
    """A field of the frames: its description, and the function that reads its value, None if it has none."""

    description: FieldDescription
    read: Callable[[], Value | None]


def field(
    name: str,
    read: Callable[[], Value | None],
    *,
    unit: str = "",
    size: int | None = None,
    boolean: bool = False,
    meaning: str = "",
) -> Field:
    """Return a field for a server: numbers in a base unit (mm, s, deg, A, V, degC, or plain), or bools.

    Raises:
        ValueError: the unit is invalid, or not a base unit.
    """
    description = FieldDescription(
        name=name, kind="bool" if boolean else "number", unit=unit, size=size, meaning=meaning
    )
    field_type(description)
    return Field(description, read)


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


class Service(QuietNode):
    """A server of a user's methods and fields. Mutable.

    An exception in a handler or field is reported, and the server keeps running: the call is refused, or the
    field has no value.
    """

    def __init__(self, name: str, methods: Iterable[Method], fields: Iterable[Field], report: Report) -> None:
        self.address = name
        self._fields = tuple(fields)
        self._report = report
        reporting_methods = tuple(m._replace(handler=self._report_errors(m)) for m in methods)
        description = Description(
            server=name,
            fields=tuple(f.description for f in self._fields),
            methods=tuple(MethodDescription(name=m.name, right=m.right) for m in reporting_methods),
        )
        describe = calls.method("describe", NoArguments, lambda *_: description, right="read")
        self._publisher = Publisher(name, self._read)
        self._calls = CallDispatcher(
            name, (*reporting_methods, describe), other_limit_messages=lambda: self._publisher.limit_messages
        )
        self._now_ns = 0
        self.listens = (*self._calls.listens, *(self._publisher.listens if self._fields else ()))

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Publish the fields on a tick or a fetch, and answer calls."""
        if isinstance(message, (Tick, Fetch)):
            self._now_ns = now_ns
            for effect in self._publisher.handle(message):
                yield effect
                yield from _acknowledgement(effect)
        else:
            yield from self._calls.handle(message, now_ns)

    def _report_errors(self, method: Method) -> calls.Handler:
        """Return the method's handler, with its exceptions reported and turned into refusals."""

        def handle(call_id: CallId, arguments: Any, now_ns: int) -> object:
            try:
                return method.handler(call_id, arguments, now_ns)
            except RefusedError:
                raise
            except Exception as problem:
                where = f"{self.address}.{method.name}"
                self._report(f"{where} failed:\n{traceback.format_exc()}")
                raise RefusedError("failed", f"{where} failed: {type(problem).__name__}: {problem}") from None

        return handle

    def _read(self, tick: Tick) -> Fields:
        return {f.description.name: self._sample(f) for f in self._fields}

    def _sample(self, field: Field) -> Sample | None:
        try:
            value = field.read()
        except Exception:
            self._report(f"{self.address}.{field.description.name} failed:\n{traceback.format_exc()}")
            return None
        return None if value is None else Sample(value, self._now_ns)


def _acknowledgement(effect: Effect) -> Iterator[Effect]:
    """Yield the frame, without its fields, for the Clock, which listens to no frames of a user's servers."""
    if isinstance(effect, Send) and isinstance(effect.message, ServerFrame):
        yield Send(topics.ANSWERS, msgspec.structs.replace(effect.message, fields={}))
