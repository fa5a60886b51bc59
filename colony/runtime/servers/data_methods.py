"""The methods of DServer for variables and semaphores (thesis section 4.6.1).

The functions of `library/data.py` make these calls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice

import msgspec

from colony.ir.program import in_declared_units
from colony.ir.types import ScalarValue, Value
from colony.runtime.library.data import (
    CreateSemaphore,
    Get,
    GetMany,
    History,
    ListNames,
    Named,
    SemaphoreState,
    Set,
    SetHistory,
    SetMany,
    TimedValue,
    Wait,
)
from colony.runtime.protocol.calls import LATER, CallId, Later, Method, RefusedError, method
from colony.runtime.protocol.deployment import ActuatorTable
from colony.runtime.servers.names import SortedNames, checked_name
from colony.runtime.servers.semaphores import Semaphores, timed_out
from colony.runtime.servers.variables import (
    MAX_DECODED_BYTES,
    MAX_VALUE_BYTES,
    CheckedValue,
    StoredValue,
    Variables,
    checked_value,
    encoded,
    unknown_variable,
)

MAX_REPLY_BYTES = 3 << 20
"""Byte limit of the values in one reply, so that it fits into a message."""

MAX_NAMES_PER_REPLY = 5000
"""Largest number of names in one reply."""

MAX_VALUES_PER_REPLY = 2000
"""Largest number of values of a history in one reply."""

MAX_NAMES_PER_CALL = 1000
"""Largest number of variables that one call sets, gets, watches or publishes."""

MAX_SET_BYTES = MAX_VALUE_BYTES + 1024
"""Byte limit of the arguments of `set` and `set_many`: one value of the largest size, with its name."""

MAX_NAMES_BYTES = 1 << 18
"""Byte limit of the arguments of calls that list names: `MAX_NAMES_PER_CALL` names of 255 bytes."""


class DataMethods:
    """The calls for variables and semaphores. Mutable: these, `answers` and `wake_at`.

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
        self.answers: list[tuple[CallId, object]] = []
        self.wake_at: int | None = None

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods; those that need the right to command change the state."""
        return (
            method("set", Set, self._set, max_bytes=MAX_SET_BYTES),
            method("set_many", SetMany, self._set_many, max_bytes=MAX_SET_BYTES),
            method("get", Get, self._get, right="read"),
            method("get_many", GetMany, self._get_many, right="read", max_bytes=MAX_NAMES_BYTES),
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
        self.answers += [(waiter.call_id, timed_out(waiter.name)) for waiter in late]
        self.wake_at = self._semaphores.wake_at

    def drop(self, connection: str) -> tuple[int, ...]:
        """Remove a connection from all queues, and release the semaphores that it holds.

        Return the numbers of the calls that took them.
        """
        held, granted = self._semaphores.drop(connection)
        self.answers += [(call_id, None) for call_id in granted]
        return held

    # --- variables -----------------------------------------------------------------------------------

    def _set(self, call_id: CallId, arguments: Set, now_ns: int) -> None:
        name = checked_name(arguments.name)
        self._variables.set((checked_value(name, arguments.value),), now_ns)
        self._changed(name)

    def _set_many(self, call_id: CallId, arguments: SetMany, now_ns: int) -> None:
        values = checked_values(arguments)
        self._variables.set(values, now_ns)
        for value in values:
            self._changed(value.name)

    def _get(self, call_id: CallId, arguments: Get, now_ns: int) -> msgspec.Raw:
        try:
            return msgspec.Raw(self._variables.value(arguments.name, arguments.back).data)
        except RefusedError:
            if not self._variables.has(arguments.name) and self._semaphores.has(arguments.name):
                raise RefusedError("unknown", f"DServer: `{arguments.name}` is a semaphore") from None
            raise

    def _get_many(self, call_id: CallId, arguments: GetMany, now_ns: int) -> dict[str, msgspec.Raw]:
        check_count(len(arguments.names))
        missing = [name for name in arguments.names if not self._variables.has(name)]
        if missing:
            raise unknown_variable("`, `".join(missing[:10]))
        found = {name: self._variables.value(name) for name in arguments.names}
        _fit(found.values(), "fewer variables")
        return {name: msgspec.Raw(stored.data) for name, stored in found.items()}

    def _history(self, call_id: CallId, arguments: History, now_ns: int) -> tuple[TimedValue, ...]:
        limit = arguments.limit
        if not 1 <= limit <= MAX_VALUES_PER_REPLY or arguments.back > 0:
            wrong = f"{limit} values of a history, starting at value {arguments.back}"
            expected = f"1 to {MAX_VALUES_PER_REPLY}, starting at value 0 or an older one"
            raise RefusedError("arguments", f"DServer: {wrong}; expected {expected}")
        found = tuple(islice(self._variables.history(arguments.name, arguments.back), limit))
        _fit(found, "fewer values, or single ones by `get`")
        return tuple(_timed(stored) for stored in found)

    def _set_history(self, call_id: CallId, arguments: SetHistory, now_ns: int) -> None:
        self._variables.set_history(checked_name(arguments.name), arguments.length)

    def _delete(self, call_id: CallId, arguments: Named, now_ns: int) -> bool:
        deleted = self._variables.delete(arguments.name)
        if deleted:
            self._changed(arguments.name)
        return deleted

    def _names(self, call_id: CallId, arguments: ListNames, now_ns: int) -> tuple[str, ...]:
        return _page(self._variables.names, arguments)

    # --- semaphores ----------------------------------------------------------------------------------

    def _create_semaphore(self, call_id: CallId, arguments: CreateSemaphore, now_ns: int) -> bool:
        return self._semaphores.create(checked_name(arguments.name), arguments.value)

    def _wait(self, call_id: CallId, arguments: Wait, now_ns: int) -> Later | None:
        name, hold = arguments.name, arguments.hold
        waiter = self._semaphores.wait(call_id, name, arguments.wait_ns, now_ns, hold=hold)
        if waiter is None:
            return None
        due = waiter.until_ns
        if due is not None and (self.wake_at is None or due < self.wake_at):
            self.wake_at = due
        return LATER

    def _signal(self, call_id: CallId, arguments: Named, now_ns: int) -> None:
        self._grant(self._semaphores.signal(arguments.name, call_id.caller.connection))

    def _release(self, call_id: CallId, arguments: Named, now_ns: int) -> None:
        self._grant(self._semaphores.release(arguments.name, call_id.caller.connection))

    def _semaphore(self, call_id: CallId, arguments: Named, now_ns: int) -> SemaphoreState:
        return self._semaphores.state(arguments.name)

    def _semaphore_names(self, call_id: CallId, arguments: ListNames, now_ns: int) -> tuple[str, ...]:
        return _page(self._semaphores.names, arguments)

    def _delete_semaphore(self, call_id: CallId, arguments: Named, now_ns: int) -> bool:
        deleted, waited = self._semaphores.delete(arguments.name)
        refused = RefusedError("deleted", f"DServer: `{arguments.name}` was deleted")
        self.answers += [(waiter, refused) for waiter in waited]
        return deleted

    def _grant(self, call_id: CallId | None) -> None:
        """Answer a call to which a semaphore was granted."""
        if call_id is not None:
            self.answers.append((call_id, None))


def command(
    variables: Variables, actuator: ActuatorTable, values: tuple[ScalarValue, ...], now_ns: int
) -> None:
    """Set the variable that an actuator is bound to; one field becomes a value, several a list.

    Args:
        variables: the variables of DServer.
        actuator: the actuator.
        values: the command, in base units.
        now_ns: the time.
    """
    declared = in_declared_units(values, actuator.fields)
    assert declared is not None
    value: Value = declared[0] if len(declared) == 1 else declared
    variables.put(checked_value(actuator.command, encoded(value)), now_ns)


def _timed(stored: StoredValue) -> TimedValue:
    return TimedValue(t_ns=stored.t_ns, value=msgspec.Raw(stored.data))


def _fit(datings: Iterable[StoredValue], instead: str) -> None:
    size = sum(len(stored.data) + 16 for stored in datings)
    if size > MAX_REPLY_BYTES:
        text = f"DServer: {size} bytes of values do not fit into one reply; ask for {instead}"
        raise RefusedError("size", text)


def checked_values(arguments: SetMany) -> list[CheckedValue]:
    """Return the checked values of a call of `set_many`.

    Raises:
        RefusedError: "arguments" or "size".
    """
    check_count(arguments.count)
    try:
        values = arguments.read()
    except (msgspec.DecodeError, UnicodeDecodeError) as problem:
        raise RefusedError("arguments", f"DServer.set_many: {problem} of the values") from None
    readable = len(memoryview(arguments.values)) <= MAX_DECODED_BYTES
    return [checked_value(checked_name(name), value, readable=readable) for name, value in values.items()]


def check_count(count: int) -> None:
    """Check the number of names in one call.

    Raises:
        RefusedError: "size".
    """
    if count > MAX_NAMES_PER_CALL:
        raise RefusedError(
            "size", f"DServer: {count} names in one call; expected at most {MAX_NAMES_PER_CALL}"
        )


def _page(names: SortedNames, wanted: ListNames) -> tuple[str, ...]:
    """Return the names that a call asks for.

    Raises:
        RefusedError: "arguments".
    """
    if not 1 <= wanted.limit <= MAX_NAMES_PER_REPLY:
        raise RefusedError(
            "arguments", f"DServer: a limit of {wanted.limit} names; expected 1 to {MAX_NAMES_PER_REPLY}"
        )
    return names.page(wanted.prefix, wanted.after, wanted.limit)
