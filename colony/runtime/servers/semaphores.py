"""DServer's semaphores (thesis section 4.6.1, "Semaphores").

A semaphore has a value and a queue, first come first served; while a call waits, the value is 0. A signal
grants the semaphore to the first waiting call; only if none waits does it increment the value.

As in the thesis, nobody owns a semaphore that was taken. But a client may take it as a *hold*: then it
belongs to the connection and call that took it, and is released when the connection is lost.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from colony.runtime.library.data import SemaphoreState
from colony.runtime.protocol.calls import CallId, RefusedError
from colony.runtime.servers.call_answers import ResourceLimit
from colony.runtime.servers.variables import SortedNames
from colony.runtime.store.store import Journal, Key

MAX_SEMAPHORES = 10_000
"""Maximum number of semaphores."""

MAX_HOLDS = 2_000
"""Maximum number of holds of all connections together; all may end at the same time."""

MAX_WAITING_CALLS = 1_000
"""Maximum number of calls waiting for semaphores; all may be answered at the same time."""

UNLIMITED_WAIT_NS = 10**17
"""Nanoseconds (three years) from which a timeout counts as unlimited."""

MAX_INITIAL_VALUE = (1 << 31) - 1
"""Maximum initial value of a semaphore."""


class Waiter(NamedTuple):
    """A call that waits for a semaphore until `expires_ns` (None: forever), as a hold if `hold` is True."""

    call_id: CallId
    name: str
    expires_ns: int | None
    hold: bool


@dataclass(frozen=False, slots=True, kw_only=True)
class _Semaphore:
    value: int
    waiting: OrderedDict[CallId, Waiter] = field(default_factory=OrderedDict)
    holds: dict[tuple[str, int], None] = field(default_factory=dict)  # connections and numbers of calls


class Semaphores:
    """All semaphores. Mutable; values and holds are written to the journal, queues are not.

    Methods return the waiting calls that are to be answered.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._semaphores: dict[str, _Semaphore] = {}
        self._holds: dict[str, dict[int, str]] = {}  # semaphores by connection and number of the call
        self._waits: dict[str, dict[CallId, Waiter]] = {}  # by connection
        self._hold_count = self._waiting_count = 0
        self._semaphore_limit = ResourceLimit("semaphores", MAX_SEMAPHORES)
        self._hold_limit = ResourceLimit("holds of semaphores", MAX_HOLDS)
        self._waiting_limit = ResourceLimit("calls that wait for semaphores", MAX_WAITING_CALLS)
        self.names = SortedNames()

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """User-readable messages about the limits reached since the server started."""
        return (
            *self._semaphore_limit.limit_messages(len(self._semaphores)),
            *self._hold_limit.limit_messages(self._hold_count),
            *self._waiting_limit.limit_messages(self._waiting_count),
        )

    def has(self, name: str) -> bool:
        """Return True if there is a semaphore of this name."""
        return name in self._semaphores

    def state(self, name: str) -> SemaphoreState:
        """Return the state of a semaphore.

        Raises:
            RefusedError: "unknown".
        """
        semaphore = self._find(name)
        return SemaphoreState(
            value=semaphore.value,
            waiting=tuple(call_id.caller.connection for call_id in semaphore.waiting),
            holding=tuple(connection for connection, _ in semaphore.holds),
        )

    def create(self, name: str, value: int) -> bool:
        """Create a semaphore; return False if it exists already.

        Raises:
            RefusedError: "arguments" or "full".
        """
        if name in self._semaphores:
            return False
        if not 0 <= value <= MAX_INITIAL_VALUE:
            raise RefusedError(
                "arguments", f"DServer: an initial value of {value}; expected 0 to {MAX_INITIAL_VALUE}"
            )
        if not self._semaphore_limit.allows(len(self._semaphores) + 1):
            raise RefusedError("full", f"DServer already has {MAX_SEMAPHORES} semaphores")
        self._semaphores[name] = _Semaphore(value=0)
        self.names.add(name)
        self._set(name, value)
        return True

    def delete(self, name: str) -> tuple[bool, tuple[CallId, ...]]:
        """Remove a semaphore; return True if it existed, and the waiting calls, which are to be refused."""
        semaphore = self._semaphores.get(name)
        if semaphore is None:
            return False, ()
        self._journal.drop(Key("semaphore", name))
        for connection, number in [*semaphore.holds]:
            self._end_hold(connection, number)
        waiting = tuple(semaphore.waiting)
        for call_id in waiting:
            self._remove_waiter(call_id)
        del self._semaphores[name]
        self.names.discard(name)
        return True, waiting

    # --- taking and releasing ------------------------------------------------------------------------

    def wait(
        self, call_id: CallId, name: str, wait_ns: int | None, now_ns: int, *, hold: bool
    ) -> Waiter | None:
        """Take the semaphore and return None, or queue the call and return its `Waiter`.

        Raises:
            RefusedError: "unknown", "timeout" or "full".
        """
        semaphore = self._find(name)
        if hold and not self._hold_limit.allows(self._hold_count + 1):
            raise RefusedError("full", f"DServer already has {MAX_HOLDS} holds")
        if semaphore.value > 0:
            self._set(name, semaphore.value - 1)
            if hold:
                self._begin_hold(call_id, name)
            return None
        if wait_ns is not None and wait_ns <= 0:
            raise timeout_refusal(name)
        if not self._waiting_limit.allows(self._waiting_count + 1):
            raise RefusedError("full", f"DServer already has {MAX_WAITING_CALLS} waiting calls")
        expires_ns = None if wait_ns is None or wait_ns >= UNLIMITED_WAIT_NS else now_ns + wait_ns
        waiter = Waiter(call_id, name, expires_ns, hold)
        semaphore.waiting[call_id] = waiter
        self._waits.setdefault(call_id.caller.connection, {})[call_id] = waiter
        self._waiting_count += 1
        return waiter

    def signal(self, name: str, connection: str) -> CallId | None:
        """Signal a semaphore, and end a hold of `connection`; return the waiting call that gets it, if any.

        Raises:
            RefusedError: "unknown".
        """
        self._find(name)
        number = self._hold_number(connection, name)
        if number is not None:
            self._end_hold(connection, number)
        return self._put_back(name)

    def release(self, name: str, connection: str) -> CallId | None:
        """Release a semaphore that the connection holds; return the waiting call that gets it, if any.

        Raises:
            RefusedError: "unknown" or "not held".
        """
        self._find(name)
        if self._hold_number(connection, name) is None:
            raise RefusedError("not held", f"DServer: this connection does not hold `{name}` (any more)")
        return self.signal(name, connection)

    def drop(self, connection: str) -> tuple[tuple[int, ...], tuple[CallId, ...]]:
        """Remove a lost connection from all queues, and release its holds.

        Return the numbers of the calls that took the holds, and the waiting calls that get the semaphores.
        """
        for waiting in [*self._waits.get(connection, ())]:
            self._remove_waiter(waiting)
        held = tuple(self._holds.get(connection, {}).items())
        granted = []
        for number, name in held:
            self._end_hold(connection, number)
            call_id = self._put_back(name)
            if call_id is not None:
                granted.append(call_id)
        return tuple(number for number, _ in held), tuple(granted)

    def holders_except(self, connections: Container[str]) -> tuple[str, ...]:
        """Return the connections that hold a semaphore and are not among these."""
        return tuple(connection for connection in self._holds if connection not in connections)

    # --- time ----------------------------------------------------------------------------------------

    @property
    def wake_at(self) -> int | None:
        """The earliest timeout of the waiting calls."""
        return min((w.expires_ns for w in self._waiters() if w.expires_ns is not None), default=None)

    def expire(self, now_ns: int) -> tuple[Waiter, ...]:
        """Remove and return the calls whose timeout has passed; they are to be refused."""
        expired = tuple(w for w in self._waiters() if w.expires_ns is not None and now_ns >= w.expires_ns)
        for waiter in expired:
            self._remove_waiter(waiter.call_id)
        return expired

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the entries of kinds "semaphore" and "hold" from a store."""
        for key, data in entries.items():
            if key.kind == "semaphore":
                self._semaphores[key.name] = _Semaphore(value=_values.decode(data))
        self.names.update(self._semaphores)
        for key, data in entries.items():
            if key.kind == "hold":
                name = _names.decode(data)
                self._holds.setdefault(key.name, {})[key.slot] = name
                self._semaphores[name].holds[key.name, key.slot] = None
                self._hold_count += 1

    # --- internals -----------------------------------------------------------------------------------

    def _find(self, name: str) -> _Semaphore:
        semaphore = self._semaphores.get(name)
        if semaphore is None:
            raise RefusedError("unknown", f"DServer has no semaphore `{name}`")
        return semaphore

    def _set(self, name: str, value: int) -> None:
        self._semaphores[name].value = value
        self._journal.put(Key("semaphore", name), _encode(value))

    def _put_back(self, name: str) -> CallId | None:
        """Grant a semaphore to the first waiting call and return it; if none waits, increment the value."""
        semaphore = self._semaphores[name]
        if not semaphore.waiting:
            self._set(name, semaphore.value + 1)
            return None
        first = next(iter(semaphore.waiting.values()))
        self._remove_waiter(first.call_id)
        if first.hold:
            self._begin_hold(first.call_id, name)
        return first.call_id

    def _waiters(self) -> Iterator[Waiter]:
        return (waiter for waits in self._waits.values() for waiter in waits.values())

    def _remove_waiter(self, call_id: CallId) -> None:
        waits = self._waits[call_id.caller.connection]
        del self._semaphores[waits.pop(call_id).name].waiting[call_id]
        if not waits:
            del self._waits[call_id.caller.connection]
        self._waiting_count -= 1

    def _begin_hold(self, call_id: CallId, name: str) -> None:
        connection, number = call_id.caller.connection, call_id.number
        self._holds.setdefault(connection, {})[number] = name
        self._semaphores[name].holds[connection, number] = None
        self._hold_count += 1
        self._journal.put(Key("hold", connection, number), _encode(name))

    def _end_hold(self, connection: str, number: int) -> None:
        held = self._holds[connection]
        del self._semaphores[held.pop(number)].holds[connection, number]
        if not held:
            del self._holds[connection]
        self._hold_count -= 1
        self._journal.drop(Key("hold", connection, number))

    def _hold_number(self, connection: str, name: str) -> int | None:
        """Return the number of the first call by which a connection holds a semaphore, None if none."""
        held = self._holds.get(connection)
        return None if held is None else next((number for number, n in held.items() if n == name), None)


def timeout_refusal(name: str) -> RefusedError:
    """Return the refusal of a call whose wait timed out."""
    return RefusedError("timeout", f"DServer: `{name}` was not signaled in time")


_encode = msgspec.msgpack.Encoder().encode
_values = msgspec.msgpack.Decoder(int)
_names = msgspec.msgpack.Decoder(str)
