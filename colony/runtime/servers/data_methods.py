"""The methods of DServer for variables and semaphores (thesis section 4.6.1).

The functions of `library/data.py` call them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice

import msgspec

from colony.ir.program import in_declared_units
from colony.ir.types import ScalarValue, Value
from colony.runtime.library.data import (
    CreateSemaphore,
    Dated,
    Get,
    GetMany,
    History,
    ListNames,
    Named,
    SemaphoreState,
    Set,
    SetHistory,
    SetMany,
    Wait,
)
from colony.runtime.protocol.calls import LATER, Asked, Later, Method, RefusedError, method
from colony.runtime.protocol.deployment import ActuatorTable
from colony.runtime.servers.naming import Names, named
from colony.runtime.servers.semaphores import Semaphores, timed_out
from colony.runtime.servers.variables import (
    READ_BYTES,
    VALUE_BYTES,
    Dating,
    Prepared,
    Variables,
    encoded,
    prepared,
    unknown,
)

REPLY_BYTES = 3 << 20
"""Byte limit of the values in one reply, so that it fits into a message."""

MOST_NAMES = 5000
"""Largest number of names in one reply."""

MOST_VALUES = 2000
"""Largest number of values of a history in one reply."""

MOST_AT_ONCE = 1000
"""Largest number of variables that one call sets, gets, watches or publishes."""

SET_BYTES = VALUE_BYTES + 1024
"""Byte limit of the arguments of `set` and `set_many`: one value of the largest size, with its name."""

NAMES_BYTES = 1 << 18
"""Byte limit of the arguments of calls that list names: `MOST_AT_ONCE` names of 255 bytes."""


class DataMethods:
    """The calls for variables and semaphores. Mutable: those, `answers` and `wake_at`.

    Args:
        variables: the variables.
        semaphores: the semaphores.
        changed: called with the name of each variable that a call changes.

    Attributes:
        answers: results, or refusals, of calls that waited; the sender empties the list.
        wake_at: the time of the next `expire`; None if no call waits with a timeout.
    """

    def __init__(
        self, variables: Variables, semaphores: Semaphores, changed: Callable[[str], None] = lambda name: None
    ) -> None:
        self._variables = variables
        self._semaphores = semaphores
        self._changed = changed
        self.answers: list[tuple[Asked, object]] = []
        self.wake_at: int | None = None

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods for variables and semaphores; those that need the right to command change state."""
        return (
            method("set", Set, self._set, largest=SET_BYTES),
            method("set_many", SetMany, self._set_many, largest=SET_BYTES),
            method("get", Get, self._get, right="read"),
            method("get_many", GetMany, self._get_many, right="read", largest=NAMES_BYTES),
            method("history", History, self._history, right="read"),
            method("set_history", SetHistory, self._set_history),
            method("delete", Named, self._delete),
            method("names", ListNames, self._names, right="read"),
            method("create_semaphore", CreateSemaphore, self._create_semaphore),
            method("wait", Wait, self._wait),
            method("signal", Named, self._signal),
            method("release", Named, self._release),
            method("semaphore", Named, self._semaphore, right="read"),
            method("semaphores", ListNames, self._semaphore_names, right="read"),
            method("delete_semaphore", Named, self._delete_semaphore),
        )

    def expire(self, now_ns: int) -> None:
        """Refuse the calls whose timeout has passed."""
        if self.wake_at is None or now_ns < self.wake_at:
            return
        late = self._semaphores.expire(now_ns)
        self.answers += [(waiter.asked, timed_out(waiter.name)) for waiter in late]
        self.wake_at = self._semaphores.wake_at

    def drop(self, connection: str) -> tuple[int, ...]:
        """Release a connection's places in queues, and the semaphores that it holds.

        Return the numbers of the calls by which it held them.
        """
        held, granted = self._semaphores.drop(connection)
        self.answers += [(asked, None) for asked in granted]
        return held

    # --- variables -----------------------------------------------------------------------------------

    def _set(self, asked: Asked, arguments: Set, now_ns: int) -> None:
        name = named(arguments.name)
        self._variables.set((prepared(name, arguments.value),), now_ns)
        self._changed(name)

    def _set_many(self, asked: Asked, arguments: SetMany, now_ns: int) -> None:
        values = several(arguments)
        self._variables.set(values, now_ns)
        for value in values:
            self._changed(value.name)

    def _get(self, asked: Asked, arguments: Get, now_ns: int) -> msgspec.Raw:
        try:
            return msgspec.Raw(self._variables.value(arguments.name, arguments.back).data)
        except RefusedError:
            if not self._variables.has(arguments.name) and self._semaphores.has(arguments.name):
                raise RefusedError("unknown", f"DServer: `{arguments.name}` is a semaphore") from None
            raise

    def _get_many(self, asked: Asked, arguments: GetMany, now_ns: int) -> dict[str, msgspec.Raw]:
        few(len(arguments.names))
        missing = [name for name in arguments.names if not self._variables.has(name)]
        if missing:
            raise unknown("`, `".join(missing[:10]))
        found = {name: self._variables.value(name) for name in arguments.names}
        _fit(found.values(), "fewer variables")
        return {name: msgspec.Raw(dating.data) for name, dating in found.items()}

    def _history(self, asked: Asked, arguments: History, now_ns: int) -> tuple[Dated, ...]:
        limit = arguments.limit
        if not 1 <= limit <= MOST_VALUES or arguments.back > 0:
            wrong = f"{limit} values of a history, from value {arguments.back} on"
            expected = f"1 to {MOST_VALUES}, from value 0 or an older one on"
            raise RefusedError("arguments", f"DServer: {wrong}; expected {expected}")
        found = tuple(islice(self._variables.history(arguments.name, arguments.back), limit))
        _fit(found, "fewer values, or single ones by `get`")
        return tuple(_dated(dating) for dating in found)

    def _set_history(self, asked: Asked, arguments: SetHistory, now_ns: int) -> None:
        self._variables.set_history(named(arguments.name), arguments.length)

    def _delete(self, asked: Asked, arguments: Named, now_ns: int) -> bool:
        deleted = self._variables.delete(arguments.name)
        if deleted:
            self._changed(arguments.name)
        return deleted

    def _names(self, asked: Asked, arguments: ListNames, now_ns: int) -> tuple[str, ...]:
        return _page(self._variables.names, arguments)

    # --- semaphores ----------------------------------------------------------------------------------

    def _create_semaphore(self, asked: Asked, arguments: CreateSemaphore, now_ns: int) -> bool:
        return self._semaphores.create(named(arguments.name), arguments.value)

    def _wait(self, asked: Asked, arguments: Wait, now_ns: int) -> Later | None:
        name, hold = arguments.name, arguments.hold
        waiter = self._semaphores.wait(asked, name, arguments.wait_ns, now_ns, hold=hold)
        if waiter is None:
            return None
        due = waiter.until_ns
        if due is not None and (self.wake_at is None or due < self.wake_at):
            self.wake_at = due
        return LATER

    def _signal(self, asked: Asked, arguments: Named, now_ns: int) -> None:
        self._grant(self._semaphores.signal(arguments.name, asked.caller.connection))

    def _release(self, asked: Asked, arguments: Named, now_ns: int) -> None:
        self._grant(self._semaphores.release(arguments.name, asked.caller.connection))

    def _semaphore(self, asked: Asked, arguments: Named, now_ns: int) -> SemaphoreState:
        return self._semaphores.state(arguments.name)

    def _semaphore_names(self, asked: Asked, arguments: ListNames, now_ns: int) -> tuple[str, ...]:
        return _page(self._semaphores.names, arguments)

    def _delete_semaphore(self, asked: Asked, arguments: Named, now_ns: int) -> bool:
        deleted, waited = self._semaphores.delete(arguments.name)
        refused = RefusedError("deleted", f"DServer: `{arguments.name}` was deleted")
        self.answers += [(waiter, refused) for waiter in waited]
        return deleted

    def _grant(self, asked: Asked | None) -> None:
        """Answer a call that waited for a semaphore and has got it."""
        if asked is not None:
            self.answers.append((asked, None))


def command(
    variables: Variables, actuator: ActuatorTable, values: tuple[ScalarValue, ...], now_ns: int
) -> None:
    """Set the variable that an actuator is bound to; one field is a value, several are a list.

    Args:
        variables: the variables of DServer.
        actuator: the actuator.
        values: its command, in base units.
        now_ns: the time.
    """
    declared = in_declared_units(values, actuator.fields)
    assert declared is not None
    value: Value = declared[0] if len(declared) == 1 else declared
    variables.put(prepared(actuator.command, encoded(value)), now_ns)


def _dated(dating: Dating) -> Dated:
    return Dated(t_ns=dating.t_ns, value=msgspec.Raw(dating.data))


def _fit(datings: Iterable[Dating], instead: str) -> None:
    size = sum(len(dating.data) + 16 for dating in datings)
    if size > REPLY_BYTES:
        text = f"DServer: {size} bytes of values are too many for one reply; ask for {instead}"
        raise RefusedError("size", text)


def several(arguments: SetMany) -> list[Prepared]:
    """Return the values, checked, that a call of `set_many` sets.

    Raises:
        RefusedError: "arguments" or "size".
    """
    few(arguments.count)
    try:
        values = arguments.read()
    except (msgspec.DecodeError, UnicodeDecodeError) as problem:
        raise RefusedError("arguments", f"DServer.set_many: {problem} of the values") from None
    readable = len(memoryview(arguments.values)) <= READ_BYTES
    return [prepared(named(name), value, readable=readable) for name, value in values.items()]


def few(count: int) -> None:
    """Check the number of names in one call.

    Raises:
        RefusedError: "size".
    """
    if count > MOST_AT_ONCE:
        raise RefusedError("size", f"DServer: {count} names in one call; expected at most {MOST_AT_ONCE}")


def _page(names: Names, wanted: ListNames) -> tuple[str, ...]:
    """Return the names that a call asks for.

    Raises:
        RefusedError: "arguments".
    """
    if not 1 <= wanted.limit <= MOST_NAMES:
        raise RefusedError(
            "arguments", f"DServer: a limit of {wanted.limit} names; expected 1 to {MOST_NAMES}"
        )
    return names.page(wanted.prefix, wanted.after, wanted.limit)
