"""Calls of DServer: variables with a history, semaphores, and notices of changes.

The calls are those of thesis section 4.6.1:

    connection.do(data.set("PosX", 4))
    x = connection.do(data.get("PosX", type=int))

A value is whatever msgspec can encode in msgpack: numbers, bools, strings, bytes, None, lists, mappings,
dataclasses and structs. Numbers, bools and flat lists of them can also be fields of DServer's frames, to
which the sensors of programs are bound: frames show the variables that the program reads, and those that a
connection requested by `publish`. A name has 1 to 255 bytes of UTF-8.

Acknowledged changes survive a crash of the server. Each call is executed once, even if it is repeated because
no answer came. Besides the codes given below, calls are refused with "arguments"; "size" for a value or a
call that is too large; "full" if the server or its disk has no space for more.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar, overload

import msgspec

from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.messages import Notice

T = TypeVar("T")

_MARGIN_S = 1.0
"""Seconds by which a caller's wait for a semaphore exceeds the server's."""

# --- arguments -------------------------------------------------------------------------------------


class Set(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `set`: a variable and its new value in msgpack."""

    name: str
    value: msgspec.Raw


class SetMany(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `set_many`: a mapping from variables to their new values, in msgpack.

    It stays encoded, so that the server can check its length first.
    """

    values: msgspec.Raw

    @property
    def count(self) -> int:
        """The number of entries of the mapping, as its first bytes state it; 0 if it is not a mapping."""
        head = bytes(memoryview(self.values)[:5])
        if head[0] & 0xF0 == 0x80:
            return head[0] & 0x0F
        sizes = {0xDE: 2, 0xDF: 4}
        return int.from_bytes(head[1 : 1 + sizes.get(head[0], 0)], "big")

    def read(self) -> dict[str, msgspec.Raw]:
        """Decode the mapping from variables to their values.

        Raises:
            msgspec.DecodeError, UnicodeDecodeError: it is not such a mapping.
        """
        return _raw_mapping.decode(self.values)


class Get(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `get`: a variable, and the value to read: 0 is the current one, -1 the one before it."""

    name: str
    back: int = 0


class GetMany(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `get_many`: variables by name."""

    names: tuple[str, ...]


class HistoryArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `history`: a variable, the first of its values to return, and their number."""

    name: str
    back: int = 0
    limit: int = 2000


class SetHistory(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `set_history`: a variable, and the number of values to keep."""

    name: str
    length: int


class NameArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `delete`, `semaphore`, `delete_semaphore`, `signal` and `release`: a name."""

    name: str


class ListNames(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `names` and `semaphores`: up to `limit` names with `prefix` that come after `after`."""

    prefix: str = ""
    after: str = ""
    limit: int = 1000


class CreateSemaphore(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `create_semaphore`: its name and initial value."""

    name: str
    value: int = 1


class Wait(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `wait`: a semaphore, and the maximum time to wait (None: no limit).

    With `hold`, the semaphore is released when the connection is lost.
    """

    name: str
    wait_ns: int | None = None
    hold: bool = False


class Publish(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `publish`: variables by name."""

    names: tuple[str, ...]


class Watch(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `watch` and `unwatch`: variables by name, and prefixes of names."""

    names: tuple[str, ...] = ()
    prefixes: tuple[str, ...] = ()


# --- results ---------------------------------------------------------------------------------------


class TimedValue(msgspec.Struct, frozen=True, kw_only=True):
    """A value in msgpack, and the robot's time at which it was set."""

    t_ns: int
    value: msgspec.Raw

    def read(self, type: Any = Any) -> Any:
        """Return the value.

        Raises:
            msgspec.ValidationError: the value is not of this type.
        """
        return msgspec.msgpack.decode(self.value, type=type)


class Change(msgspec.Struct, frozen=True, kw_only=True):
    """The body of a notice about a variable: its current value, or None if it was deleted."""

    name: str
    present: TimedValue | None


class SemaphoreState(msgspec.Struct, frozen=True, kw_only=True):
    """A semaphore's value, and the connections that wait for it and that hold it, in order."""

    value: int
    waiting: tuple[str, ...]
    holding: tuple[str, ...]


# --- variables -------------------------------------------------------------------------------------


def set(name: str, value: object) -> CallRequest[None]:
    """Set a variable to a new value (`DATA_SETVALUE`).

    Raises:
        TypeError, OverflowError: msgspec cannot encode the value.
    """
    return CallRequest("set", Set(name=name, value=_raw(value)), type(None), "command", repeatable=True)


def set_many(values: Mapping[str, object]) -> CallRequest[None]:
    """Set several variables atomically: no reader sees some of them old and some new.

    The limits are 1,000 variables, and 1 MiB of names and values.

    Raises:
        TypeError, OverflowError: msgspec cannot encode a value.
    """
    arguments = SetMany(values=_raw({name: _raw(value) for name, value in values.items()}))
    return CallRequest("set_many", arguments, type(None), "command", repeatable=True)


@overload
def get(name: str, back: int = 0) -> CallRequest[Any]: ...
@overload
def get(name: str, back: int = 0, *, type: type[T]) -> CallRequest[T]: ...
def get(name: str, back: int = 0, *, type: Any = Any) -> CallRequest[Any]:
    """Read a value of a variable (`DATA_GETVALUE`): 0 is the current one, -1 the one before it.

    A history of length n has the values back to -(n - 1). Refused with "unknown" if there is no such
    variable, "range" if `back` is outside the history, and "unset" if the variable has not been set that
    often yet.
    """
    return CallRequest("get", Get(name=name, back=back), type, "read", repeatable=True)


def get_many(names: Iterable[str]) -> CallRequest[dict[str, Any]]:
    """Read the current values of several variables in one call; refused like `get` if any has no value."""
    return CallRequest("get_many", GetMany(names=tuple(names)), dict[str, Any], "read", repeatable=True)


def history(name: str, back: int = 0, limit: int = 2000) -> CallRequest[tuple[TimedValue, ...]]:
    """Read up to `limit` values of a variable with their times, newest first, beginning with value `back`.

    Value 0 is the current one, -1 the one before it. Refused with "unknown", and with "size" if the values
    are too large for one reply.
    """
    arguments = HistoryArguments(name=name, back=back, limit=limit)
    return CallRequest("history", arguments, tuple[TimedValue, ...], "read", repeatable=True)


def set_history(name: str, length: int) -> CallRequest[None]:
    """Set the number of values of a variable to keep, including the current one (`DATA_SETHISTORY`).

    The default is 1. Shortening a history drops its oldest values. The variable need not be set yet.
    """
    arguments = SetHistory(name=name, length=length)
    return CallRequest("set_history", arguments, type(None), "command", repeatable=True)


def delete(name: str) -> CallRequest[bool]:
    """Remove a variable and its history; the reply is False if there is none."""
    return CallRequest("delete", NameArguments(name=name), bool, "command", repeatable=True)


def names(prefix: str = "", *, after: str = "", limit: int = 1000) -> CallRequest[tuple[str, ...]]:
    """List up to `limit` names of variables, in order, beginning after the name `after`."""
    arguments = ListNames(prefix=prefix, after=after, limit=limit)
    return CallRequest("names", arguments, tuple[str, ...], "read", repeatable=True)


def publish(names: Iterable[str]) -> CallRequest[None]:
    """Show these variables, too, in DServer's frames, as long as this connection is open.

    Frames show numbers, bools and flat lists of them. A variable that does not exist yet is shown as soon as
    it is set. Further calls add variables, up to 1,000 for a connection. Refused with "full" if frames have
    no room for them. Use a connection's `keep` for this call, so that it is repeated after a restart of the
    server.
    """
    return CallRequest("publish", Publish(names=tuple(names)), type(None), "read", repeatable=True)


# --- semaphores ------------------------------------------------------------------------------------


def create_semaphore(name: str, value: int = 1) -> CallRequest[bool]:
    """Create a semaphore (`DATA_CREATE_SEM`); the reply is False, and nothing changes, if it exists."""
    arguments = CreateSemaphore(name=name, value=value)
    return CallRequest("create_semaphore", arguments, bool, "command", repeatable=True)


def wait(name: str, timeout_s: float | None = None, *, hold: bool = False) -> CallRequest[None]:
    """Take a semaphore, or wait until it can be taken (`DATA_WAIT`), first come first served.

    Refused with "timeout", "unknown", or "deleted". A lost connection no longer waits.

    Args:
        name: the semaphore.
        timeout_s: the maximum time to wait; 0 to not wait, None for no limit.
        hold: True to release the semaphore when this connection is lost.
    """
    if timeout_s is None or timeout_s == math.inf:
        arguments = Wait(name=name, wait_ns=None, hold=hold)
        return CallRequest("wait", arguments, type(None), "command", repeatable=True, wait_s=math.inf)
    arguments = Wait(name=name, wait_ns=round(timeout_s * 1e9), hold=hold)
    wait_s = timeout_s + _MARGIN_S if timeout_s > 0 else None
    return CallRequest("wait", arguments, type(None), "command", repeatable=True, wait_s=wait_s)


def signal(name: str) -> CallRequest[None]:
    """Signal a semaphore (`DATA_SIGNAL`): the first waiting connection gets it immediately.

    If this connection holds the semaphore, its hold ends. Refused with "unknown".
    """
    return CallRequest("signal", NameArguments(name=name), type(None), "command", repeatable=True)


def release(name: str) -> CallRequest[None]:
    """Release a semaphore that was taken with `hold`.

    Refused with "not held" if this connection does not hold the semaphore. If it took the semaphore before,
    the connection was lost in the meantime, and another connection may have held the semaphore as well.
    """
    return CallRequest("release", NameArguments(name=name), type(None), "command", repeatable=True)


def semaphore(name: str) -> CallRequest[SemaphoreState]:
    """Read the state of a semaphore. Refused with "unknown"."""
    return CallRequest("semaphore", NameArguments(name=name), SemaphoreState, "read", repeatable=True)


def semaphores(prefix: str = "", *, after: str = "", limit: int = 1000) -> CallRequest[tuple[str, ...]]:
    """List the names of semaphores, as `names` does for variables."""
    arguments = ListNames(prefix=prefix, after=after, limit=limit)
    return CallRequest("semaphores", arguments, tuple[str, ...], "read", repeatable=True)


def delete_semaphore(name: str) -> CallRequest[bool]:
    """Remove a semaphore; the reply is False if there is none.

    Calls that wait for it are refused with "deleted".
    """
    return CallRequest("delete_semaphore", NameArguments(name=name), bool, "command", repeatable=True)


# --- changes ---------------------------------------------------------------------------------------


def watch(*names: str, prefixes: Iterable[str] = ()) -> CallRequest[None]:
    """Subscribe to notices about these variables, and all whose names begin with one of `prefixes`.

    One notice comes for each variable that has a value, and another each time one is set or deleted. The
    subject of a notice is the name of the variable; its body is a `Change`. A reopened connection gets the
    current values again. Further calls add to the subscription. When very many notices are due, some are
    delayed, and a variable that changes again before its notice is sent gets a single one.
    """
    return CallRequest(
        "watch", Watch(names=names, prefixes=tuple(prefixes)), type(None), "read", repeatable=True
    )


def unwatch(*names: str, prefixes: Iterable[str] = ()) -> CallRequest[None]:
    """Cancel notices about these variables and prefixes, or all notices if none is given."""
    return CallRequest(
        "unwatch", Watch(names=names, prefixes=tuple(prefixes)), type(None), "read", repeatable=True
    )


def change(notice: Notice) -> Change:
    """Decode a notice about a watched variable.

    Raises:
        msgspec.DecodeError: the notice is not about a variable.
    """
    return msgspec.msgpack.decode(notice.body, type=Change)


_raw_mapping = msgspec.msgpack.Decoder(dict[str, msgspec.Raw])


def _raw(value: object) -> msgspec.Raw:
    return msgspec.Raw(msgspec.msgpack.encode(value))
