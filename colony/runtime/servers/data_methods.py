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
    HistoryArguments,
    ListNames,
    NameArguments,
    SemaphoreState,
    Set,
    SetHistory,
    SetMany,
    TimedValue,
    Wait,
)
from colony.runtime.protocol.calls import LATER, CallId, Later, Method, RefusedError, method
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.servers.semaphores import Semaphores, timeout_refusal
from colony.runtime.servers.variables import (
    MAX_DECODED_BYTES,
    MAX_VALUE_BYTES,
    CheckedValue,
    SortedNames,
    StoredValue,
    Variables,
    encode_value,
    unknown_variable,
    validate_name,
    validate_value,
)

MAX_REPLY_BYTES = 3 << 20
"""Byte limit of the values in one reply, so that it fits into a message."""

MAX_NAMES_PER_REPLY = 5000
"""Maximum number of names in one reply."""

MAX_VALUES_PER_REPLY = 2000
"""Maximum number of values of a history in one reply."""

MAX_NAMES_PER_CALL = 1000
"""Maximum number of variables that one call sets, gets, watches or publishes."""

MAX_SET_BYTES = MAX_VALUE_BYTES + 1024
"""Byte limit of the arguments of `set` and `set_many`: one value of the largest size, with its name."""

MAX_NAMES_BYTES = 1 << 18
"""Byte limit of the arguments of calls that list names: `MAX_NAMES_PER_CALL` names of 255 bytes."""


class DataMethods:
    """The methods for variables and semaphores. Mutable.

    Args:
        variables: the variables.
        semaphores: the semaphores.
        on_change: called with the name of each variable that a call changes.

    Attributes:
        answers: results, or refusals, of calls that waited; the sender empties the list.
        wake_at: the time of the next `expire`; None if no call waits with a timeout.
    """

    def __init__(
        self,
        variables: Variables,
        semaphores: Semaphores,
        on_change: Callable[[str], None] = lambda name: None,
    ) -> None:
        self._variables = variables
        self._semaphores = semaphores
        self._on_change = on_change
        self.answers: list[tuple[CallId, object]] = []
        self.wake_at: int | None = None

    @property
    def methods(self) -> tuple[Method, ...]:
        """All methods; those that need the right to command change the state."""
        return (
            method("set", Set, self._set, max_bytes=MAX_SET_BYTES),
            method("set_many", SetMany, self._set_many, max_bytes=MAX_SET_BYTES),
            method("get", Get, self._get, right="read"),
            method("get_many", GetMany, self._get_many, right="read", max_bytes=MAX_NAMES_BYTES),
            method("history", HistoryArguments, self._history, right="read"),
            method("set_history", SetHistory, self._set_history),
            method("delete", NameArguments, self._delete),
            method("names", ListNames, self._names, right="read"),
            method("create_semaphore", CreateSemaphore, self._create_semaphore),
            method("wait", Wait, self._wait),
            method("signal", NameArguments, self._signal),
            method("release", NameArguments, self._release),
            method("semaphore", NameArguments, self._semaphore, right="read"),
            method("semaphores", ListNames, self._semaphore_names, right="read"),
            method("delete_semaphore", NameArguments, self._delete_semaphore),
        )

    def expire(self, now_ns: int) -> None:
        """Refuse the calls whose timeout has passed."""
        if self.wake_at is None or now_ns < self.wake_at:
            return
        expired = self._semaphores.expire(now_ns)
        self.answers += [(waiter.call_id, timeout_refusal(waiter.name)) for waiter in expired]
        self.wake_at = self._semaphores.wake_at

    def drop(self, connection: str) -> tuple[int, ...]:
        """Remove a connection from all queues, and release the semaphores that it holds.

        Return the numbers of the calls by which it took these semaphores.
        """
        held, granted = self._semaphores.drop(connection)
        self.answers += [(call_id, None) for call_id in granted]
        return held

    # --- variables -----------------------------------------------------------------------------------

    def _set(self, call_id: CallId, arguments: Set, now_ns: int) -> None:
        name = validate_name(arguments.name)
        self._variables.set((validate_value(name, arguments.value),), now_ns)
        self._on_change(name)

    def _set_many(self, call_id: CallId, arguments: SetMany, now_ns: int) -> None:
        values = validate_values(arguments)
        self._variables.set(values, now_ns)
        for value in values:
            self._on_change(value.name)

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
        values = {name: self._variables.value(name) for name in arguments.names}
        _check_reply_size(values.values(), "fewer variables")
        return {name: msgspec.Raw(stored.data) for name, stored in values.items()}

    def _history(self, call_id: CallId, arguments: HistoryArguments, now_ns: int) -> tuple[TimedValue, ...]:
        limit = arguments.limit
        if not 1 <= limit <= MAX_VALUES_PER_REPLY or arguments.back > 0:
            wrong = f"{limit} values of a history, starting at value {arguments.back}"
            expected = f"1 to {MAX_VALUES_PER_REPLY}, starting at value 0 or an older one"
            raise RefusedError("arguments", f"DServer: {wrong}; expected {expected}")
        values = tuple(islice(self._variables.history(arguments.name, arguments.back), limit))
        _check_reply_size(values, "fewer values, or for single ones by `get`")
        return tuple(_timed_value(stored) for stored in values)

    def _set_history(self, call_id: CallId, arguments: SetHistory, now_ns: int) -> None:
        self._variables.set_history(validate_name(arguments.name), arguments.length)

    def _delete(self, call_id: CallId, arguments: NameArguments, now_ns: int) -> bool:
        deleted = self._variables.delete(arguments.name)
        if deleted:
            self._on_change(arguments.name)
        return deleted

    def _names(self, call_id: CallId, arguments: ListNames, now_ns: int) -> tuple[str, ...]:
        return _page(self._variables.names, arguments)

    # --- semaphores ----------------------------------------------------------------------------------

    def _create_semaphore(self, call_id: CallId, arguments: CreateSemaphore, now_ns: int) -> bool:
        return self._semaphores.create(validate_name(arguments.name), arguments.value)

    def _wait(self, call_id: CallId, arguments: Wait, now_ns: int) -> Later | None:
        name, hold = arguments.name, arguments.hold
        waiter = self._semaphores.wait(call_id, name, arguments.wait_ns, now_ns, hold=hold)
        if waiter is None:
            return None
        due = waiter.expires_ns
        if due is not None and (self.wake_at is None or due < self.wake_at):
            self.wake_at = due
        return LATER

    def _signal(self, call_id: CallId, arguments: NameArguments, now_ns: int) -> None:
        self._grant(self._semaphores.signal(arguments.name, call_id.caller.connection))

    def _release(self, call_id: CallId, arguments: NameArguments, now_ns: int) -> None:
        self._grant(self._semaphores.release(arguments.name, call_id.caller.connection))

    def _semaphore(self, call_id: CallId, arguments: NameArguments, now_ns: int) -> SemaphoreState:
        return self._semaphores.state(arguments.name)

    def _semaphore_names(self, call_id: CallId, arguments: ListNames, now_ns: int) -> tuple[str, ...]:
        return _page(self._semaphores.names, arguments)

    def _delete_semaphore(self, call_id: CallId, arguments: NameArguments, now_ns: int) -> bool:
        deleted, waiting = self._semaphores.delete(arguments.name)
        refused = RefusedError("deleted", f"DServer: `{arguments.name}` was deleted")
        self.answers += [(call_id, refused) for call_id in waiting]
        return deleted

    def _grant(self, call_id: CallId | None) -> None:
        """Answer a call to which a semaphore was granted."""
        if call_id is not None:
            self.answers.append((call_id, None))


def set_commanded_variable(
    variables: Variables, actuator: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int
) -> None:
    """Set the variable that an actuator is bound to: to the value of a single field, or to a list of several.

    Args:
        variables: the variables of DServer.
        actuator: the actuator.
        values: the command, in base units.
        now_ns: the time.
    """
    declared = in_declared_units(values, actuator.fields)
    assert declared is not None
    value: Value = declared[0] if len(declared) == 1 else declared
    variables.put(validate_value(actuator.command, encode_value(value)), now_ns)


def _timed_value(stored: StoredValue) -> TimedValue:
    return TimedValue(t_ns=stored.t_ns, value=msgspec.Raw(stored.data))


def _check_reply_size(values: Iterable[StoredValue], smaller: str) -> None:
    size = sum(len(stored.data) + 16 for stored in values)
    if size > MAX_REPLY_BYTES:
        text = f"DServer: {size} bytes of values do not fit into one reply; ask for {smaller}"
        raise RefusedError("size", text)


def validate_values(arguments: SetMany) -> list[CheckedValue]:
    """Check the values of a call of `set_many`, and return them.

    Raises:
        RefusedError: "arguments" or "size".
    """
    check_count(arguments.count)
    try:
        values = arguments.read()
    except (msgspec.DecodeError, UnicodeDecodeError) as problem:
        raise RefusedError("arguments", f"DServer.set_many: {problem} of the values") from None
    readable = len(memoryview(arguments.values)) <= MAX_DECODED_BYTES
    return [validate_value(validate_name(name), value, readable=readable) for name, value in values.items()]


def check_count(count: int) -> None:
    """Check the number of names in one call.

    Raises:
        RefusedError: "size".
    """
    if count > MAX_NAMES_PER_CALL:
        raise RefusedError(
            "size", f"DServer: {count} names in one call; expected at most {MAX_NAMES_PER_CALL}"
        )


def _page(names: SortedNames, request: ListNames) -> tuple[str, ...]:
    """Return the names that a call asks for.

    Raises:
        RefusedError: "arguments".
    """
    if not 1 <= request.limit <= MAX_NAMES_PER_REPLY:
        raise RefusedError(
            "arguments", f"DServer: a limit of {request.limit} names; expected 1 to {MAX_NAMES_PER_REPLY}"
        )
    return names.page(request.prefix, request.after, request.limit)
