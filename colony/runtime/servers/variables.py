"""DServer's variables: named values with a history each (thesis section 4.6.1, "Ordinary Variables").

Values are kept in msgpack, as they came; `showing.py` decides how frames show them. The store has each value
of a history in a slot of its own (see `_Variable.slot`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple

import msgspec

from colony.ir.types import Value
from colony.runtime.frames.publishing import Fields
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.servers.bounds import Bound
from colony.runtime.servers.naming import Names
from colony.runtime.servers.showing import FRAME_SPACE, Showing, Shown, showing
from colony.runtime.store.store import Journal, Key

MOST = 20_000
"""Largest number of variables."""

VALUE_BYTES = 1 << 20
"""Byte limit of a value, in msgpack."""

READ_BYTES = 1 << 14
"""Size in bytes up to which a value is decoded before it is accepted.

Text must be UTF-8, and keys must be hashable. Of larger values only the structure is checked, because
decoding them could take a fifth of a second.
"""

HISTORY_LENGTH = 10_000
"""Largest number of values in a history."""

SPACE = 1 << 26
"""Byte limit of all variables with their histories.

Each variable and each value counts for `OVERHEAD` more.
"""

OVERHEAD = 200
"""Bytes of memory that a value takes besides its own (measured: 210)."""

LONG_AGO_NS = 10**17
"""Nanoseconds before the present at which values of another clock are dated: three years."""


_HELD = Key("fact", "held")


class Dating(NamedTuple):
    """A value in msgpack, its number in its variable (from 0), and the time at which it was set."""

    turn: int
    t_ns: int
    data: bytes


class Prepared(NamedTuple):
    """A checked value in msgpack, and its showing in frames."""

    name: str
    data: bytes
    shown: Showing


@dataclass(frozen=False, slots=True, kw_only=True)
class _Variable:
    length: int
    turn: int = 0
    values: deque[Dating] = field(default_factory=deque)
    shown_size: int = 0

    def slot(self, turn: int) -> int:
        """Return the store's slot for the value of a turn.

        It is the same for every length but 1, so that a history that gets longer or shorter leaves its values
        where they are.
        """
        return 0 if self.length == 1 else turn % HISTORY_LENGTH


class Variables:
    """All variables. Mutable: those; changes go into the journal.

    Args:
        journal: the journal of changes.
        space: the byte limit of all values (`SPACE`).
        frame_space: the byte limit of the program's part of frames.
    """

    def __init__(self, journal: Journal, *, space: int = SPACE, frame_space: int = FRAME_SPACE) -> None:
        self._journal = journal
        self._space = Bound("values of variables", space, in_bytes=True)
        self._most = Bound("variables", MOST)
        self._used = 0
        self._variables: dict[str, _Variable] = {}
        self._shown = Shown(frame_space)
        self._held: set[str] = set()
        self.names = Names()

    # --- reading -------------------------------------------------------------------------------------

    @property
    def reached(self) -> tuple[str, ...]:
        """Sentences for users about limits that are reached, or were since the server started."""
        count = self._most.reached(len(self._variables))
        return (*count, *self._space.reached(self._used), *self._shown.reached)

    def fields(self, now_ns: int) -> Fields:
        """Return the fields of a frame: numbers, bools and lists of them that were asked for.

        As long as nothing changes it is the same object, so that the frames that are kept share it; held
        variables get a new time in each frame.
        """
        shown = self._shown.fields()
        held = {
            name: sample._replace(t_ns=now_ns)
            for name in self._held
            if (sample := shown.get(name)) is not None
        }
        return {**shown, **held} if held else shown

    def expect_frames_with(self, names: Iterable[str]) -> None:
        """Check that frames have room for these variables, too.

        Raises:
            RefusedError: "full".
        """
        known = (self._variables.get(name) for name in names)
        self._shown.expect_room_besides(
            sum(variable.shown_size for variable in known if variable is not None)
        )

    def read_by_program(self, names: Iterable[str]) -> None:
        """Show these variables, and only these, as the ones that the program reads."""
        self._refresh(self._shown.read(names))

    def show(self, names: Iterable[str]) -> None:
        """Show these variables in frames from now on, including those that are set only later."""
        names = tuple(names)
        for name in names:
            self._shown.want(name)
        self._refresh(names)

    def _refresh(self, names: Iterable[str]) -> None:
        for name in names:
            variable = self._variables.get(name)
            if variable is not None and 0 < variable.shown_size <= self._shown.space:
                present = variable.values[-1]
                self._shown.put(name, showing(name, present.data), present.t_ns)

    def hide(self, names: Iterable[str]) -> None:
        """Stop showing these variables in frames."""
        for name in names:
            self._shown.unwant(name)

    def has(self, name: str) -> bool:
        """Return True if there is a variable of this name."""
        return name in self._variables

    def present(self, name: str) -> Dating | None:
        """Return the present value, None if there is none."""
        variable = self._variables.get(name)
        return variable.values[-1] if variable is not None and variable.values else None

    def value(self, name: str, back: int = 0) -> Dating:
        """Return the value `-back` times before the present one.

        Raises:
            RefusedError: "unknown", "range" or "unset".
        """
        variable = self._variables.get(name)
        if variable is None:
            raise unknown(name)
        if back == 0 and variable.values:
            return variable.values[-1]
        if not -variable.length < back <= 0:
            least = 1 - variable.length
            text = f"DServer: there is no value {back} of `{name}`; expected {least} to 0"
            raise RefusedError("range", text if least else f"{text}, as its history is 1 long")
        if -back >= len(variable.values):
            times = "never" if not variable.values else f"only {len(variable.values)} times"
            raise RefusedError(
                "unset", f"DServer: there is no value {back} of `{name}` yet; it was set {times}"
            )
        return variable.values[back - 1]

    def history(self, name: str, back: int = 0) -> Iterator[Dating]:
        """Yield the values kept, the newest first, from the value `-back` times before the present one on.

        Raises:
            RefusedError: "unknown".
        """
        if name not in self._variables:
            raise unknown(name)
        return islice(reversed(self._variables[name].values), max(0, -back), None)

    # --- changes -------------------------------------------------------------------------------------

    def set(self, prepared: Sequence[Prepared], now_ns: int) -> None:
        """Set several variables, of different names, at one moment.

        Raises:
            RefusedError: "full"; nothing is set then.
        """
        growth = frame_growth = 0
        new = 0
        for one in prepared:
            variable = self._variables.get(one.name)
            growth += _cost(one.data)
            frame_growth += self._shown.growth(one.name, one.shown.size)
            if variable is None:
                growth += OVERHEAD + len(one.name)
                new += 1
            elif len(variable.values) == variable.length:
                growth -= _cost(variable.values[0].data)
        self._expect_room(growth, new)
        self._shown.expect_room(frame_growth)
        for one in prepared:
            self.put(one, now_ns)

    def put(self, one: Prepared, now_ns: int) -> None:
        """Set one variable without checking limits."""
        name, data, shown = one
        if name in self._held:
            self._let_go(name)
        variable = self._variables.get(name) or self._make(name, 1)
        values = variable.values
        dating = Dating(variable.turn, now_ns, data)
        slot = variable.slot(dating.turn)
        if len(values) == variable.length:
            oldest = values.popleft()
            self._used -= _cost(oldest.data)
            if variable.slot(oldest.turn) != slot:
                self._journal.drop(Key("value", name, variable.slot(oldest.turn)))
        variable.turn += 1
        values.append(dating)
        self._used += _cost(data)
        self._journal.put(Key("value", name, slot), _encode(dating))
        variable.shown_size = shown.size
        self._shown.put(name, shown, now_ns)

    def _expect_room(self, growth: int, new: int) -> None:
        if new and not self._most.allows(len(self._variables) + new):
            raise RefusedError("full", f"DServer has no room for more than {self._most.most} variables")
        if growth > 0 and not self._space.allows(self._used + growth):
            raise RefusedError(
                "full", f"DServer has no room for more than {self._space.most} bytes of values"
            )

    def hold(self, held: Mapping[str, Value]) -> None:
        """Set variables that stay as fresh as each frame until they are set again; hold no others."""
        for name, value in held.items():
            self.put(prepared(name, encoded(value)), 0)
        if self._held != set(held):
            self._held = set(held)
            self._note_held()

    def set_history(self, name: str, length: int) -> None:
        """Keep `length` values of a variable from now on; create a missing one, without a value.

        Raises:
            RefusedError: "arguments" or "full".
        """
        if not 1 <= length <= HISTORY_LENGTH:
            raise RefusedError(
                "arguments", f"DServer: a history of {length} values; expected 1 to {HISTORY_LENGTH}"
            )
        variable = self._variables.get(name)
        if variable is None:
            self._expect_room(OVERHEAD + len(name), 1)
            self._make(name, length)
            return
        while len(variable.values) > length:
            oldest = variable.values.popleft()
            self._used -= _cost(oldest.data)
            self._journal.drop(Key("value", name, variable.slot(oldest.turn)))
        before = {dating.turn: variable.slot(dating.turn) for dating in variable.values}
        variable.length = length
        self._journal.put(Key("variable", name), _encode(length))
        self._move(name, variable, before)

    def delete(self, name: str) -> bool:
        """Remove a variable; return False if there is none."""
        variable = self._variables.pop(name, None)
        if variable is None:
            return False
        self._journal.drop(Key("variable", name))
        for dating in variable.values:
            self._journal.drop(Key("value", name, variable.slot(dating.turn)))
        self._used -= OVERHEAD + len(name) + sum(_cost(dating.data) for dating in variable.values)
        self._shown.drop(name)
        self.names.discard(name)
        if name in self._held:
            self._let_go(name)
        return True

    def _let_go(self, name: str) -> None:
        self._held.discard(name)
        self._note_held()

    def _note_held(self) -> None:
        self._journal.put(_HELD, _encode(sorted(self._held)))

    def _make(self, name: str, length: int) -> _Variable:
        variable = self._variables[name] = _Variable(length=length)
        self.names.add(name)
        self._used += OVERHEAD + len(name)
        self._journal.put(Key("variable", name), _encode(length))
        return variable

    def _move(self, name: str, variable: _Variable, before: Mapping[int, int]) -> None:
        """Move values to the slots where they belong, from the slots in which they are by their turns."""
        moved = [dating for dating in variable.values if before[dating.turn] != variable.slot(dating.turn)]
        for dating in moved:
            self._journal.drop(Key("value", name, before[dating.turn]))
        for dating in moved:
            self._journal.put(Key("value", name, variable.slot(dating.turn)), _encode(dating))

    # --- from the store ------------------------------------------------------------------------------

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the entries of a store of the kinds "variable" and "value", and the held variables."""
        for key, data in entries.items():
            if key.kind == "variable":
                self._variables[key.name] = _Variable(length=_lengths.decode(data))
                self._used += OVERHEAD + len(key.name)
        self.names.update(self._variables)
        kept = [(key, _datings.decode(data)) for key, data in entries.items() if key.kind == "value"]
        slots: dict[str, dict[int, int]] = {}
        for key, dating in sorted(kept, key=lambda one: one[1].turn):
            variable = self._variables[key.name]
            variable.values.append(dating)
            variable.turn = dating.turn + 1
            self._used += _cost(dating.data)
            slots.setdefault(key.name, {})[dating.turn] = key.slot
        for name, before in slots.items():
            variable = self._variables[name]
            variable.shown_size = showing(name, variable.values[-1].data).size
            self._move(name, variable, before)
        if _HELD in entries:
            self._held = {name for name in _names.decode(entries[_HELD]) if name in self._variables}

    def age(self, now_ns: int, *, all_of_them: bool) -> None:
        """Make values old whose times are of another clock, at the start, before frames show any.

        Those are the values of the future, or `all_of_them`.
        """
        for name, variable in self._variables.items():
            for dating in [*variable.values]:
                if all_of_them or dating.t_ns > now_ns:
                    dating = dating._replace(t_ns=now_ns - LONG_AGO_NS)
                    self._journal.put(Key("value", name, variable.slot(dating.turn)), _encode(dating))
                variable.values.rotate(-1)
                variable.values[-1] = dating


def prepared(name: str, value: msgspec.Raw | bytes, *, readable: bool = True) -> Prepared:
    """Check a value, and copy it out of its message.

    Args:
        name: the variable.
        value: the value in msgpack; its structure was checked when the message was decoded.
        readable: True to decode it too, and refuse a value that no client could read (see `READ_BYTES`).

    Raises:
        RefusedError: "arguments" for a value that is no msgpack, "size" for one that is too large.
    """
    data = bytes(value)
    if len(data) > VALUE_BYTES:
        text = f"DServer: the value of `{name}` has {len(data)} bytes; expected at most {VALUE_BYTES}"
        raise RefusedError("size", text)
    shown = showing(name, data)
    try:
        if readable and shown.value is None and len(data) <= READ_BYTES:
            _anything.decode(data)
    except (msgspec.DecodeError, ValueError, TypeError, RecursionError) as problem:
        raise RefusedError("arguments", f"DServer: the value of `{name}`: {problem}") from None
    return Prepared(name, data, shown)


def unknown(name: str) -> RefusedError:
    """Return the refusal of a call for a variable that does not exist."""
    return RefusedError("unknown", f"DServer has no variable `{name}`")


def _cost(data: bytes) -> int:
    return len(data) + OVERHEAD


def encoded(value: Value) -> bytes:
    """Return a value of a program in msgpack."""
    return _encode(value)


_encode = msgspec.msgpack.Encoder().encode
_anything: msgspec.msgpack.Decoder[object] = msgspec.msgpack.Decoder()
_lengths = msgspec.msgpack.Decoder(int)
_names = msgspec.msgpack.Decoder(list[str])
_datings = msgspec.msgpack.Decoder(Dating)
