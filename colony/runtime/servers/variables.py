"""DServer's variables: named values with a history each (thesis section 4.6.1, "Ordinary Variables").

Values are kept in msgpack, as received; `frame_content.py` decides how frames show them. In the store, each
value of a history has a slot of its own (see `_Variable.slot`).
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, takewhile
from operator import itemgetter
from typing import NamedTuple

import msgspec

from colony.ir.types import Value
from colony.runtime.frames.publishing import Fields
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.servers.call_answers import ResourceLimit
from colony.runtime.servers.frame_content import FAULTY, FRAME_SPACE, FrameContent, FrameValue, frame_value
from colony.runtime.store.store import Journal, Key

# --- names ---------------------------------------------------------------------------------------------
#
# Names of DServer's variables and semaphores: validation, and sorted lists for paging.


class SortedNames:
    """A sorted list of names. Mutable."""

    def __init__(self) -> None:
        self._names: list[str] = []

    def add(self, name: str) -> None:
        """Add a name that is not in the list."""
        insort(self._names, name)

    def update(self, names: Iterable[str]) -> None:
        """Add many names that are not in the list."""
        self._names = sorted([*self._names, *names])

    def discard(self, name: str) -> None:
        """Remove a name that is in the list."""
        del self._names[bisect_left(self._names, name)]

    def page(self, prefix: str, after: str, limit: int) -> tuple[str, ...]:
        """Return the first `limit` names that begin with `prefix` and sort after `after`."""
        begin = max(bisect_left(self._names, prefix), bisect_right(self._names, after))
        candidates = islice(self._names, begin, begin + limit)
        return tuple(takewhile(lambda name: name.startswith(prefix), candidates))

    def with_prefixes(self, prefixes: Iterable[str]) -> Iterator[str]:
        """Yield each name that begins with one of the prefixes, once, in order."""
        covered: str | None = None
        for prefix in sorted(prefixes):
            if covered is not None and prefix.startswith(covered):
                continue
            covered = prefix
            begin = bisect_left(self._names, prefix)
            end = bisect_right(self._names, prefix, lo=begin, key=itemgetter(slice(len(prefix))))
            yield from self._names[begin:end]


def validate_name(name: str) -> str:
    """Check that `name` is valid for a variable or semaphore (1 to 255 bytes of UTF-8), and return it.

    Raises:
        RefusedError: "arguments".
    """
    try:
        size = len(name.encode())
    except UnicodeEncodeError:
        raise RefusedError("arguments", f"DServer: the name {name[:20]!a} is not valid UTF-8") from None
    if not 1 <= size <= 255:
        shown = f"`{name[:20]}...`" if name else "``"
        raise RefusedError("arguments", f"DServer: the name {shown} has {size} bytes; expected 1 to 255")
    return name


# --- variables -----------------------------------------------------------------------------------------


MAX_VARIABLES = 20_000
"""Maximum number of variables."""

MAX_VALUE_BYTES = 1 << 20
"""Byte limit of a value, in msgpack."""

MAX_DECODED_BYTES = 1 << 14
"""Size in bytes up to which a value is decoded before it is accepted.

Decoding finds text that is not UTF-8 and keys that are not hashable. Of larger values only the structure is
checked, because decoding them could take a fifth of a second.
"""

MAX_HISTORY_LENGTH = 10_000
"""Maximum number of values in a history."""

MAX_TOTAL_BYTES = 1 << 26
"""Byte limit of all variables with their histories.

Each variable and each value counts for `OVERHEAD` more.
"""

OVERHEAD = 200
"""Bytes of memory that a value takes in addition to its data (measured: 210)."""

OTHER_CLOCK_AGE_NS = 10**17
"""Age in nanoseconds (three years) given to values that were dated by another clock."""


_PINNED = Key("fact", "held")


class StoredValue(NamedTuple):
    """A value in msgpack, its sequence number in its variable (from 0), and the time at which it was set."""

    sequence: int
    t_ns: int
    data: bytes


class CheckedValue(NamedTuple):
    """A checked value of a variable: in msgpack, and as frames show it."""

    name: str
    data: bytes
    shown: FrameValue


@dataclass(frozen=False, slots=True, kw_only=True)
class _Variable:
    history_length: int
    sequence: int = 0
    values: deque[StoredValue] = field(default_factory=deque)
    shown_size: int = 0

    def slot(self, sequence: int) -> int:
        """Return the store's slot for the value with a sequence number.

        It is the same for every length but 1, so that changing the length of a history moves no values.
        """
        return 0 if self.history_length == 1 else sequence % MAX_HISTORY_LENGTH


class Variables:
    """All variables. Mutable; changes are written to the journal.

    Args:
        journal: the journal of changes.
        space: the byte limit of all values (`MAX_TOTAL_BYTES`).
        frame_space: the byte limit of the program's share of frames.
    """

    def __init__(
        self, journal: Journal, *, space: int = MAX_TOTAL_BYTES, frame_space: int = FRAME_SPACE
    ) -> None:
        self._journal = journal
        self._bytes_limit = ResourceLimit("values of variables", space, in_bytes=True)
        self._count_limit = ResourceLimit("variables", MAX_VARIABLES)
        self._used = 0
        self._variables: dict[str, _Variable] = {}
        self._frame_content = FrameContent(frame_space)
        self._pinned: set[str] = set()
        self.names = SortedNames()

    # --- reading -------------------------------------------------------------------------------------

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """User-readable messages about the limits reached since the server started."""
        count = self._count_limit.limit_messages(len(self._variables))
        return (*count, *self._bytes_limit.limit_messages(self._used), *self._frame_content.limit_messages)

    def fields(self, now_ns: int) -> Fields:
        """Return the fields of a frame: the requested variables that are numbers, bools or lists of them.

        Frames share one object until something changes; but pinned variables get a new time in each frame.
        """
        shown = self._frame_content.fields()
        pinned = {
            name: sample._replace(t_ns=now_ns)
            for name in self._pinned
            if (sample := shown.get(name)) is not None
        }
        return {**shown, **pinned} if pinned else shown

    def check_frame_space(self, names: Iterable[str]) -> None:
        """Check that frames have space for these variables in addition to those shown.

        Raises:
            RefusedError: "full".
        """
        variables = (self._variables.get(name) for name in names)
        self._frame_content.check_published_space(
            sum(variable.shown_size for variable in variables if variable is not None)
        )

    def set_program_names(self, names: Iterable[str]) -> None:
        """Set the variables that the program reads, in place of earlier ones."""
        self._refresh(self._frame_content.set_program_names(names))

    def show(self, names: Iterable[str]) -> None:
        """Show these variables in frames from now on, including those not set yet."""
        names = tuple(names)
        for name in names:
            self._frame_content.show(name)
        self._refresh(names)

    def _refresh(self, names: Iterable[str]) -> None:
        for name in names:
            current = self.current(name)
            if current is not None and self._variables[name].shown_size <= self._frame_content.space:
                self._frame_content.put(name, frame_value(name, current.data), current.t_ns)

    def hide(self, names: Iterable[str]) -> None:
        """Stop showing these variables in frames."""
        for name in names:
            self._frame_content.hide(name)

    def has(self, name: str) -> bool:
        """Return True if there is a variable of this name."""
        return name in self._variables

    def current(self, name: str) -> StoredValue | None:
        """Return the current value, None if there is none."""
        variable = self._variables.get(name)
        return variable.values[-1] if variable is not None and variable.values else None

    def value(self, name: str, back: int = 0) -> StoredValue:
        """Return the value `-back` steps before the current one.

        Raises:
            RefusedError: "unknown", "range" or "unset".
        """
        variable = self._variables.get(name)
        if variable is None:
            raise unknown_variable(name)
        if back == 0 and variable.values:
            return variable.values[-1]
        if not -variable.history_length < back <= 0:
            oldest = 1 - variable.history_length
            text = f"DServer: there is no value {back} of `{name}`; expected {oldest} to 0"
            raise RefusedError("range", text if oldest else f"{text}, as its history is 1 long")
        if -back >= len(variable.values):
            times = "never" if not variable.values else f"only {len(variable.values)} times"
            raise RefusedError(
                "unset", f"DServer: there is no value {back} of `{name}` yet; it was set {times}"
            )
        return variable.values[back - 1]

    def history(self, name: str, back: int = 0) -> Iterator[StoredValue]:
        """Yield the kept values, newest first, beginning `-back` steps before the current one.

        Raises:
            RefusedError: "unknown".
        """
        if name not in self._variables:
            raise unknown_variable(name)
        return islice(reversed(self._variables[name].values), max(0, -back), None)

    # --- changes -------------------------------------------------------------------------------------

    def set(self, new_values: Sequence[CheckedValue], now_ns: int) -> None:
        """Set several variables, of different names, at the same time.

        Raises:
            RefusedError: "full"; then nothing is set.
        """
        growth = frame_growth = new_count = 0
        for value in new_values:
            variable = self._variables.get(value.name)
            growth += _cost(value.data)
            frame_growth += self._frame_content.growth(value.name, value.shown.size)
            if variable is None:
                growth += OVERHEAD + len(value.name)
                new_count += 1
            elif len(variable.values) == variable.history_length:
                growth -= _cost(variable.values[0].data)
        self._check_space(growth, new_count)
        self._frame_content.check_space(frame_growth)
        for value in new_values:
            self.put(value, now_ns)

    def put(self, value: CheckedValue, now_ns: int) -> None:
        """Set one variable without checking limits."""
        name, data, shown = value
        if name in self._pinned:
            self._unpin(name)
        variable = self._variables.get(name) or self._create(name, 1)
        values = variable.values
        stored = StoredValue(variable.sequence, now_ns, data)
        slot = variable.slot(stored.sequence)
        if len(values) == variable.history_length:
            oldest = values.popleft()
            self._used -= _cost(oldest.data)
            if variable.slot(oldest.sequence) != slot:
                self._journal.drop(Key("value", name, variable.slot(oldest.sequence)))
        variable.sequence += 1
        values.append(stored)
        self._used += _cost(data)
        self._journal.put(Key("value", name, slot), _encode(stored))
        variable.shown_size = shown.size
        self._frame_content.put(name, shown, now_ns)

    def _check_space(self, growth: int, new_count: int) -> None:
        if new_count and not self._count_limit.allows(len(self._variables) + new_count):
            raise RefusedError(
                "full", f"DServer has no room for more than {self._count_limit.limit} variables"
            )
        if growth > 0 and not self._bytes_limit.allows(self._used + growth):
            raise RefusedError(
                "full", f"DServer has no room for more than {self._bytes_limit.limit} bytes of values"
            )

    def pin(self, pinned: Mapping[str, Value]) -> None:
        """Set variables that are then fresh in every frame until a call sets them; unpin all others."""
        for name, value in pinned.items():
            self.put(validate_value(name, encode_value(value)), 0)
        if self._pinned != set(pinned):
            self._pinned = set(pinned)
            self._persist_pinned()

    def set_history(self, name: str, length: int) -> None:
        """Keep `length` values of a variable from now on; create a missing one, without a value.

        Raises:
            RefusedError: "arguments" or "full".
        """
        if not 1 <= length <= MAX_HISTORY_LENGTH:
            raise RefusedError(
                "arguments", f"DServer: a history of {length} values; expected 1 to {MAX_HISTORY_LENGTH}"
            )
        variable = self._variables.get(name)
        if variable is None:
            self._check_space(OVERHEAD + len(name), 1)
            self._create(name, length)
            return
        while len(variable.values) > length:
            oldest = variable.values.popleft()
            self._used -= _cost(oldest.data)
            self._journal.drop(Key("value", name, variable.slot(oldest.sequence)))
        old_slots = {stored.sequence: variable.slot(stored.sequence) for stored in variable.values}
        variable.history_length = length
        self._journal.put(Key("variable", name), _encode(length))
        self._move(name, variable, old_slots)

    def delete(self, name: str) -> bool:
        """Remove a variable; return False if there is none."""
        variable = self._variables.pop(name, None)
        if variable is None:
            return False
        self._journal.drop(Key("variable", name))
        for stored in variable.values:
            self._journal.drop(Key("value", name, variable.slot(stored.sequence)))
        self._used -= OVERHEAD + len(name) + sum(_cost(stored.data) for stored in variable.values)
        self._frame_content.drop(name)
        self.names.discard(name)
        if name in self._pinned:
            self._unpin(name)
        return True

    def _unpin(self, name: str) -> None:
        self._pinned.discard(name)
        self._persist_pinned()

    def _persist_pinned(self) -> None:
        self._journal.put(_PINNED, _encode(sorted(self._pinned)))

    def _create(self, name: str, length: int) -> _Variable:
        variable = self._variables[name] = _Variable(history_length=length)
        self.names.add(name)
        self._used += OVERHEAD + len(name)
        self._journal.put(Key("variable", name), _encode(length))
        return variable

    def _move(self, name: str, variable: _Variable, old_slots: Mapping[int, int]) -> None:
        """Move values from their old slots, which are given by sequence number, to their new ones."""
        moved = [
            stored
            for stored in variable.values
            if old_slots[stored.sequence] != variable.slot(stored.sequence)
        ]
        for stored in moved:
            self._journal.drop(Key("value", name, old_slots[stored.sequence]))
        for stored in moved:
            self._journal.put(Key("value", name, variable.slot(stored.sequence)), _encode(stored))

    # --- from the store ------------------------------------------------------------------------------

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the entries of kinds "variable" and "value", and the pinned variables, from a store."""
        for key, data in entries.items():
            if key.kind == "variable":
                self._variables[key.name] = _Variable(history_length=_lengths.decode(data))
                self._used += OVERHEAD + len(key.name)
        self.names.update(self._variables)
        stored_values = [
            (key, _stored_values.decode(data)) for key, data in entries.items() if key.kind == "value"
        ]
        slots: dict[str, dict[int, int]] = {}
        for key, stored in sorted(stored_values, key=lambda entry: entry[1].sequence):
            variable = self._variables[key.name]
            variable.values.append(stored)
            variable.sequence = stored.sequence + 1
            self._used += _cost(stored.data)
            slots.setdefault(key.name, {})[stored.sequence] = key.slot
        for name, old_slots in slots.items():
            variable = self._variables[name]
            variable.shown_size = frame_value(name, variable.values[-1].data).size
            self._move(name, variable, old_slots)
        if _PINNED in entries:
            self._pinned = {name for name in _names.decode(entries[_PINNED]) if name in self._variables}

    def backdate(self, now_ns: int, *, all_values: bool) -> None:
        """Backdate the values that another clock dated, before any frame shows them.

        These are values from the future; with `all_values`, all of them.
        """
        for name, variable in self._variables.items():
            for stored in [*variable.values]:
                if all_values or stored.t_ns > now_ns:
                    stored = stored._replace(t_ns=now_ns - OTHER_CLOCK_AGE_NS)
                    self._journal.put(Key("value", name, variable.slot(stored.sequence)), _encode(stored))
                variable.values.rotate(-1)
                variable.values[-1] = stored


def validate_value(name: str, value: msgspec.Raw | bytes, *, readable: bool = True) -> CheckedValue:
    """Check a value, and return a copy that is independent of its message.

    Args:
        name: the variable.
        value: the value in msgpack; its structure was checked when the message was decoded.
        readable: True to decode it too, and refuse a value that no client could read (see
            `MAX_DECODED_BYTES`).

    Raises:
        RefusedError: "arguments" for a value that is not msgpack, "size" for one that is too large.
    """
    data = bytes(value)
    if len(data) > MAX_VALUE_BYTES:
        text = f"DServer: the value of `{name}` has {len(data)} bytes; expected at most {MAX_VALUE_BYTES}"
        raise RefusedError("size", text)
    shown = frame_value(name, data)
    try:
        if readable and (shown.value is None or shown is FAULTY) and len(data) <= MAX_DECODED_BYTES:
            _anything.decode(data)
    except (msgspec.DecodeError, ValueError, TypeError, RecursionError) as problem:
        raise RefusedError("arguments", f"DServer: the value of `{name}`: {problem}") from None
    return CheckedValue(name, data, shown)


def unknown_variable(name: str) -> RefusedError:
    """Return the refusal of a call for a variable that does not exist."""
    return RefusedError("unknown", f"DServer has no variable `{name}`")


def _cost(data: bytes) -> int:
    return len(data) + OVERHEAD


def encode_value(value: Value) -> bytes:
    """Return a value of a program in msgpack."""
    return _encode(value)


_encode = msgspec.msgpack.Encoder().encode
_anything: msgspec.msgpack.Decoder[object] = msgspec.msgpack.Decoder()
_lengths = msgspec.msgpack.Decoder(int)
_names = msgspec.msgpack.Decoder(list[str])
_stored_values = msgspec.msgpack.Decoder(StoredValue)
