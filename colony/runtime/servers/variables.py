"""DServer's variables: named values with a history each (thesis section 4.6.1, "Ordinary Variables").

Values are kept in msgpack, as they came. Those that a sensor can bind to are kept as numbers too, for frames.
A history of length n is a ring: the value set as number i of its variable is in slot i mod n, so that in the
store, too, a new value takes the place of the oldest.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from colony.ir.types import Value
from colony.runtime.calls import Refused
from colony.runtime.messages import Sample
from colony.runtime.servers.publishing import Fields
from colony.runtime.store import Journal, Key

VALUE_BYTES = 1 << 20
"""Of the largest value, in msgpack."""

HISTORY_LENGTH = 10_000
"""Of the longest history."""

SPACE = 1 << 28
"""Bytes that all variables with their histories may take; each value counts for `OVERHEAD` more."""

FRAME_SPACE = 1 << 20
"""Bytes that the values in a frame may take."""

OVERHEAD = 100

LONG_AGO_NS = 10**17
"""By how much values are older than the present whose time is of another clock: three years."""


_HELD = Key("fact", "held")


class Dating(NamedTuple):
    """A value in msgpack, which of its variable's it is (from 0), and when it was set."""

    turn: int
    t_ns: int
    data: bytes


class Prepared(NamedTuple):
    """A value that may be set: in msgpack, and what frames show of it, None where they cannot."""

    name: str
    data: bytes
    shown: Value | None


@dataclass(frozen=False, slots=True, kw_only=True)
class _Variable:
    length: int
    turn: int = 0
    values: deque[Dating] = field(default_factory=deque)
    shown_bytes: int = 0


class Variables:
    """Mutable: all variables. What changes is put into the journal.

    Args:
        journal: where changes go.
        space, frame_space: the limits above.
    """

    def __init__(self, journal: Journal, *, space: int = SPACE, frame_space: int = FRAME_SPACE) -> None:
        self._journal = journal
        self._space, self._frame_space = space, frame_space
        self._used = self._frame_used = 0
        self._variables: dict[str, _Variable] = {}
        self._shown: dict[str, Sample] = {}
        self._fields: Fields | None = None
        self._held: set[str] = set()

    # --- what there is -------------------------------------------------------------------------------

    def fields(self, now_ns: int) -> Fields:
        """What a frame shows: every variable whose present value is a number, a bool, or a list of them.

        As long as nothing changes it is the same object, so that the frames that are kept share it.
        """
        if self._held:
            held = {name: self._shown[name]._replace(t_ns=now_ns) for name in self._held}
            return self._shown | held
        if self._fields is None:
            self._fields = self._shown.copy()
        return self._fields

    def names(self) -> list[str]:
        """Every variable, in order."""
        return sorted(self._variables)

    def has(self, name: str) -> bool:
        """Whether there is one of this name."""
        return name in self._variables

    def present(self, name: str) -> Dating | None:
        """The present value, if there is one."""
        variable = self._variables.get(name)
        return variable.values[-1] if variable is not None and variable.values else None

    def value(self, name: str, back: int = 0) -> Dating:
        """The value `-back` times before the present one.

        Raises:
            Refused: "unknown", "range" or "unset".
        """
        variable = self._variables.get(name)
        if variable is None:
            raise unknown(name)
        if back == 0 and variable.values:
            return variable.values[-1]
        if not -variable.length < back <= 0:
            least = 1 - variable.length
            text = f"DServer: there is no value {back} of `{name}`; expected {least} to 0"
            raise Refused("range", text if least else f"{text}, as its history is 1 long")
        if -back >= len(variable.values):
            times = "never" if not variable.values else f"only {len(variable.values)} times"
            raise Refused("unset", f"DServer: there is no value {back} of `{name}` yet; it was set {times}")
        return variable.values[back - 1]

    def history(self, name: str) -> Iterator[Dating]:
        """All values kept, the present one first.

        Raises:
            Refused: "unknown".
        """
        if name not in self._variables:
            raise unknown(name)
        return reversed(self._variables[name].values)

    # --- changes -------------------------------------------------------------------------------------

    def set(self, prepared: Sequence[Prepared], now_ns: int) -> None:
        """Set several variables, of different names, at one moment.

        Raises:
            Refused: "full"; nothing is set then.
        """
        growth = frame_growth = 0
        for one in prepared:
            variable = self._variables.get(one.name)
            growth += _cost(one.data)
            frame_growth += _frame_cost(one)
            if variable is None:
                growth += OVERHEAD + len(one.name)
            else:
                frame_growth -= variable.shown_bytes
                if len(variable.values) == variable.length:
                    growth -= _cost(variable.values[0].data)
        if growth > 0 and self._used + growth > self._space:
            raise Refused("full", f"DServer has no room for more than {self._space} bytes of values")
        if frame_growth > 0 and self._frame_used + frame_growth > self._frame_space:
            text = f"DServer's frames have no room for more than {self._frame_space} bytes of numbers"
            raise Refused("full", text)
        for one in prepared:
            self.put(one, now_ns)

    def put(self, one: Prepared, now_ns: int) -> None:
        """Set one variable, whatever room there is."""
        name, data, _ = one
        if name in self._held:
            self._let_go(name)
        variable = self._variables.get(name) or self._make(name, 1)
        values = variable.values
        if len(values) == variable.length:
            self._used -= _cost(values.popleft().data)
        dating = Dating(variable.turn, now_ns, data)
        variable.turn += 1
        values.append(dating)
        self._used += _cost(data)
        self._journal.put(Key("value", name, dating.turn % variable.length), _encode(dating))
        self._show(one, variable, now_ns)

    def hold(self, held: Mapping[str, Value]) -> None:
        """Set these as if somebody set them in every frame, each until it is set once more; and no others."""
        for name, value in held.items():
            self.put(prepared(name, encoded(value)), 0)
        if self._held != set(held):
            self._held = set(held)
            self._note_held()

    def set_history(self, name: str, length: int) -> None:
        """Keep `length` values of a variable from now on; one that is not there is made, without a value.

        Raises:
            Refused: "arguments" or "full".
        """
        if not 1 <= length <= HISTORY_LENGTH:
            raise Refused(
                "arguments", f"DServer: a history of {length} values; expected 1 to {HISTORY_LENGTH}"
            )
        variable = self._variables.get(name)
        if variable is None:
            if self._used + OVERHEAD + len(name) > self._space:
                raise Refused("full", f"DServer has no room for more than {self._space} bytes of values")
            self._make(name, length)
            return
        for dating in variable.values:
            self._journal.drop(Key("value", name, dating.turn % variable.length))
        variable.length = length
        while len(variable.values) > length:
            self._used -= _cost(variable.values.popleft().data)
        self._journal.put(Key("variable", name), _encode(length))
        for dating in variable.values:
            self._journal.put(Key("value", name, dating.turn % length), _encode(dating))

    def delete(self, name: str) -> bool:
        """Remove a variable; False where there is none."""
        variable = self._variables.pop(name, None)
        if variable is None:
            return False
        self._journal.drop(Key("variable", name))
        for dating in variable.values:
            self._journal.drop(Key("value", name, dating.turn % variable.length))
        self._used -= OVERHEAD + len(name) + sum(_cost(dating.data) for dating in variable.values)
        self._frame_used -= variable.shown_bytes
        self._shown.pop(name, None)
        self._fields = None
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
        self._used += OVERHEAD + len(name)
        self._journal.put(Key("variable", name), _encode(length))
        return variable

    def _show(self, one: Prepared, variable: _Variable, t_ns: int) -> None:
        cost = _frame_cost(one)
        if one.shown is not None or variable.shown_bytes:
            self._fields = None
        self._frame_used += cost - variable.shown_bytes
        variable.shown_bytes = cost
        if one.shown is not None:
            self._shown[one.name] = Sample(one.shown, t_ns)
        elif one.name in self._shown:
            del self._shown[one.name]

    # --- from the store ------------------------------------------------------------------------------

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Take over what a store had of the kinds "variable" and "value", and which are held."""
        for key, data in entries.items():
            if key.kind == "variable":
                self._variables[key.name] = _Variable(length=_lengths.decode(data))
                self._used += OVERHEAD + len(key.name)
        kept = [(key.name, _datings.decode(d)) for key, d in entries.items() if key.kind == "value"]
        for name, dating in sorted(kept, key=lambda one: one[1].turn):
            variable = self._variables[name]
            variable.values.append(dating)
            variable.turn = dating.turn + 1
            self._used += _cost(dating.data)
            self._show(prepared(name, dating.data), variable, dating.t_ns)
        if _HELD in entries:
            self._held = {name for name in _names.decode(entries[_HELD]) if name in self._shown}

    def age(self, now_ns: int, *, all_of_them: bool) -> None:
        """Make values old whose times are of another clock: those of the future, or `all_of_them`."""
        for name, variable in self._variables.items():
            for dating in [*variable.values]:
                if all_of_them or dating.t_ns > now_ns:
                    dating = dating._replace(t_ns=now_ns - LONG_AGO_NS)
                    self._journal.put(Key("value", name, dating.turn % variable.length), _encode(dating))
                variable.values.rotate(-1)
                variable.values[-1] = dating
            if name in self._shown:
                self._fields = None
                self._shown[name] = self._shown[name]._replace(t_ns=variable.values[-1].t_ns)


def named(name: str) -> str:
    """A name that a variable or semaphore may have.

    Raises:
        Refused: "arguments".
    """
    try:
        size = len(name.encode())
    except UnicodeEncodeError:
        raise Refused("arguments", f"DServer: the name {name!a} cannot be put into UTF-8") from None
    if not 1 <= size <= 255:
        shown = f"`{name[:20]}...`" if name else "``"
        raise Refused("arguments", f"DServer: the name {shown} has {size} bytes; expected 1 to 255")
    return name


def prepared(name: str, value: msgspec.Raw | bytes) -> Prepared:
    """A value that came, checked, and apart from the message that it came in.

    Raises:
        Refused: "arguments" for what is no msgpack, "size" for what is too large.
    """
    data = bytes(value)
    if len(data) > VALUE_BYTES:
        text = f"DServer: the value of `{name}` has {len(data)} bytes; expected at most {VALUE_BYTES}"
        raise Refused("size", text)
    try:
        return Prepared(name, data, _shown(_anything.decode(data)))
    except (msgspec.DecodeError, ValueError, TypeError, RecursionError) as problem:
        raise Refused("arguments", f"DServer: the value of `{name}`: {problem}") from None


def unknown(name: str) -> Refused:
    """That there is no such variable."""
    return Refused("unknown", f"DServer has no variable `{name}`")


def _shown(value: object) -> Value | None:
    if isinstance(value, (float, bool)):
        return value
    if isinstance(value, int):
        return float(value)
    if isinstance(value, list) and value:
        elements = tuple(float(v) if type(v) is int else v for v in value)
        return elements if all(type(e) is float or type(e) is bool for e in elements) else None
    return None


def _cost(data: bytes) -> int:
    return len(data) + OVERHEAD


def _frame_cost(one: Prepared) -> int:
    if one.shown is None:
        return 0
    numbers = len(one.shown) if isinstance(one.shown, tuple) else 1
    return len(one.name) * 4 + 9 * numbers + 16


def encoded(value: Value) -> bytes:
    """A value of a program in msgpack."""
    return _encode(value)


_encode = msgspec.msgpack.Encoder().encode
_anything: msgspec.msgpack.Decoder[object] = msgspec.msgpack.Decoder()
_lengths = msgspec.msgpack.Decoder(int)
_names = msgspec.msgpack.Decoder(list[str])
_datings = msgspec.msgpack.Decoder(Dating)
