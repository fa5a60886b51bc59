"""A server written with the kit, as a node: it takes calls, and publishes fields each frame."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

import msgspec

from colony.runtime.frames.publishing import Publisher
from colony.runtime.kit.description import Description, MethodDescription
from colony.runtime.kit.fields import Field, FieldReader, Report
from colony.runtime.protocol import calls, topics
from colony.runtime.protocol.calls import CallDispatcher, CallId, Method, NoArguments, RefusedError
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.messages import (
    Effect,
    Fetch,
    Message,
    QuietNode,
    Right,
    Send,
    ServerFrame,
    Tick,
)

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


class Service(QuietNode):
    """A server of a user's methods and fields. Mutable.

    An exception in a handler or field is reported, and the server keeps running: the call is refused, or the
    field has no value.
    """

    def __init__(self, name: str, methods: Iterable[Method], fields: Iterable[Field], report: Report) -> None:
        self.address = name
        self._fields = tuple(fields)
        self._reader = FieldReader(name, self._fields, report)
        self._report = report
        reporting_methods = tuple(m._replace(handler=self._report_errors(m)) for m in methods)
        description = Description(
            server=name,
            fields=tuple(f.description for f in self._fields),
            methods=tuple(MethodDescription(name=m.name, right=m.right) for m in reporting_methods),
        )
        describe = calls.method("describe", NoArguments, lambda *_: description, right="read")
        self._publisher = Publisher(name, lambda tick: self._reader.read(self._now_ns))
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


def _acknowledgement(effect: Effect) -> Iterator[Effect]:
    """Yield the frame, without its fields, for the Clock, which listens to no frames of a user's servers."""
    if isinstance(effect, Send) and isinstance(effect.message, ServerFrame):
        yield Send(topics.ANSWERS, msgspec.structs.replace(effect.message, fields={}))
