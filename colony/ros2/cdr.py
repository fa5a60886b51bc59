"""CDR, the encoding of ROS 2 messages: bytes to values and back, by the fields of a definition.

A definition is the fields of a message in order, each with its type as rclpy writes it: `float`,
`string<10>`, `double[36]`, `sequence<float>`, `sequence<geometry_msgs/Point, 4>`, `std_msgs/Header`.

A message begins with four bytes, of which the second says the byte order. Numbers are aligned to their size,
counted from after these bytes. A string is its length with the final zero byte, then its bytes; a sequence is
its length, then its elements. Structures and arrays have no padding or length of their own.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, assert_never

from colony.text.wording import counted

Definition = Sequence[tuple[str, str]]
"""The fields of a message: name and type of each."""

MAX_DEPTH = 16
"""Maximum depth of structures in structures."""

MAX_TRAILING = 3
"""Maximum number of bytes behind a message: some middlewares pad it to four."""

_HEAD = 4
_BIG, _LITTLE = b"\x00\x00", b"\x00\x01"


class MessageError(ValueError):
    """A message is damaged or does not have the expected type, a value does not fit, or a type is unknown."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number or a bool, by its code in `struct`."""

    code: str
    size: int


@dataclass(frozen=True, slots=True)
class Text:
    """A string of at most `bound` bytes; None if it is unbounded."""

    bound: int | None


@dataclass(frozen=True, slots=True)
class Several:
    """An array of `count` items; if that is None, a sequence of at most `bound`."""

    item: Kind
    count: int | None
    bound: int | None


@dataclass(frozen=True, slots=True)
class Structure:
    """A message or a part of it."""

    name: str
    fields: tuple[tuple[str, Kind], ...]


Kind = Number | Text | Several | Structure

_CODES = {
    "boolean": "?",
    "octet": "B",
    "byte": "B",
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float": "f",
    "double": "d",
    "float32": "f",
    "float64": "d",
}
_NUMBERS = {name: Number(code, struct.calcsize(f"<{code}")) for name, code in _CODES.items()}
_LENGTH = _NUMBERS["uint32"]

_SEQUENCE = re.compile(r"sequence<(.+?)(?:, *(\d+))?>")
_ARRAY = re.compile(r"(.+)\[(\d+)\]")
_TEXT = re.compile(r"string(?:<(\d+)>)?")
_STRUCTURE = re.compile(r"(\w+)(?:/msg)?/(\w+)")


def structure(name: str, definitions: Mapping[str, Definition]) -> Structure:
    """Return the structure of a message.

    Args:
        name: the type, such as `sensor_msgs/msg/LaserScan`.
        definitions: the fields of this type and of all those it is made of.

    Raises:
        MessageError: a definition is missing, or has a type that is not supported.
    """
    return _structure(name, definitions, 0)


def _structure(name: str, definitions: Mapping[str, Definition], depth: int) -> Structure:
    if name not in definitions:
        raise MessageError(f"the definition of `{name}` is missing")
    if depth > MAX_DEPTH:
        raise MessageError(f"`{name}` nests too deep")
    fields = tuple((field, _kind(type_, definitions, depth)) for field, type_ in definitions[name])
    return Structure(name, fields)


def _kind(type_: str, definitions: Mapping[str, Definition], depth: int) -> Kind:
    if type_ in _NUMBERS:
        return _NUMBERS[type_]
    if (found := _SEQUENCE.fullmatch(type_)) is not None:
        return Several(_kind(found[1], definitions, depth), None, int(found[2]) if found[2] else None)
    if (found := _ARRAY.fullmatch(type_)) is not None:
        return Several(_kind(found[1], definitions, depth), int(found[2]), None)
    if (found := _TEXT.fullmatch(type_)) is not None:
        return Text(int(found[1]) if found[1] else None)
    if (found := _STRUCTURE.fullmatch(type_)) is not None:
        return _structure(f"{found[1]}/msg/{found[2]}", definitions, depth + 1)
    raise MessageError(f"the type `{type_}` is not supported")


# --- decoding -------------------------------------------------------------------------------------


def decode(kind: Structure, data: bytes) -> dict[str, Any]:
    """Return the values of a message by field.

    A structure is a dictionary. An array or a sequence is a tuple; one of bytes is `bytes`.

    Raises:
        MessageError: the message is damaged, or of another type.
    """
    if data[:2] not in (_BIG, _LITTLE) or len(data) < _HEAD:
        raise MessageError(f"`{kind.name}` begins with {data[:2].hex() or 'nothing'}; expected plain CDR")
    reader = _Reader(data, "<" if data[:2] == _LITTLE else ">")
    try:
        found: dict[str, Any] = reader.read(kind)
    except MessageError as problem:
        raise MessageError(f"`{kind.name}` is damaged: {problem}") from None
    if (rest := len(data) - reader.at) > MAX_TRAILING:
        raise MessageError(f"`{kind.name}` is damaged: {counted(rest, 'byte')} left")
    return found


class _Reader:
    """Reads a message from its beginning. Mutable: knows how far it is.

    `at` is the place of the next byte, `field` the name of the field that is read.
    """

    __slots__ = ("_data", "_order", "at", "field")

    def __init__(self, data: bytes, order: str) -> None:
        self._data, self._order = data, order
        self.at, self.field = _HEAD, ""

    def read(self, kind: Kind) -> Any:
        """Return the next value."""
        match kind:
            case Number():
                return self._numbers(kind, 1)[0]
            case Text(bound=bound):
                return self._text(bound)
            case Several(item=item, count=count, bound=bound):
                return self._several(item, self._length(bound) if count is None else count)
            case Structure(fields=fields):
                if not fields:
                    self._take(1)  # an empty structure is a byte
                found = {}
                for name, of in fields:
                    self.field = name
                    found[name] = self.read(of)
                return found
            case _:
                assert_never(kind)

    def _take(self, size: int) -> int:
        """Return the place of the next `size` bytes, and pass them."""
        at = self.at
        self.at = at + size
        if self.at > len(self._data):
            missing = counted(self.at - len(self._data), "byte")
            raise MessageError(f"{missing} missing in `{self.field}`")
        return at

    def _numbers(self, kind: Number, count: int) -> tuple[Any, ...]:
        if not count:
            return ()
        self.at += -(self.at - _HEAD) % kind.size
        place = self._take(count * kind.size)
        if kind.code == "?":
            return tuple([byte != 0 for byte in self._data[place : self.at]])
        return struct.unpack_from(f"{self._order}{count}{kind.code}", self._data, place)

    def _length(self, bound: int | None) -> int:
        length: int = self._numbers(_LENGTH, 1)[0]
        if bound is not None and length > bound:
            raise MessageError(f"`{self.field}` has a length of {length}; expected at most {bound}")
        return length

    def _text(self, bound: int | None) -> str:
        length = self._length(None if bound is None else bound + 1)
        place = self._take(length)
        return self._data[place : self.at].removesuffix(b"\0").decode(errors="replace")

    def _several(self, item: Kind, count: int) -> Sequence[Any]:
        if isinstance(item, Number):
            if item.code == "B":
                place = self._take(count)
                return self._data[place : self.at]
            return self._numbers(item, count)
        if count > len(self._data) - self.at:  # each takes at least a byte
            raise MessageError(f"`{self.field}` has {count} elements, which the message has no room for")
        return tuple([self.read(item) for _ in range(count)])


# --- encoding -------------------------------------------------------------------------------------


def encode(kind: Structure, values: Mapping[str, Any], *, order: str = "<") -> bytes:
    """Return a message; what `values` lacks is zero, false, empty.

    Args:
        kind: the type of the message.
        values: the values by field; structures as mappings, arrays and sequences as sequences.
        order: the byte order, as in `struct`.

    Raises:
        MessageError: a value does not fit its field, or there is no such field.
    """
    out = bytearray(_LITTLE + b"\0\0" if order == "<" else _BIG + b"\0\0")
    _write(out, order, kind, values, kind.name)
    return bytes(out)


def _write(out: bytearray, order: str, kind: Kind, value: Any, field: str) -> None:
    match kind:
        case Number():
            _write_numbers(out, order, kind, (value or 0,), field)
        case Text(bound=bound):
            data = _fitting(value or "", str, field).encode() + b"\0"
            _check_length(len(data) - 1, bound, field)
            _write_numbers(out, order, _LENGTH, (len(data),), field)
            out += data
        case Several(item=item, count=count, bound=bound):
            items = _items(item, value, count, field)
            if count is None:
                _check_length(len(items), bound, field)
                _write_numbers(out, order, _LENGTH, (len(items),), field)
            if isinstance(item, Number):
                _write_numbers(out, order, item, items, field)
                return
            for each in items:
                _write(out, order, item, each, field)
        case Structure(fields=fields, name=name):
            found = _fitting({} if value is None else value, Mapping, field)
            if unknown := found.keys() - {key for key, _ in fields}:
                raise MessageError(f"`{name}` has no field `{min(unknown)}`")
            if not fields:
                out += b"\0"
            for key, of in fields:
                _write(out, order, of, found.get(key), key)
        case _:
            assert_never(kind)


def _items(item: Kind, value: Any, count: int | None, field: str) -> Sequence[Any]:
    if value is None:
        zero = 0 if isinstance(item, Number) else None
        return (zero,) * (count or 0)
    items: Sequence[Any] = _fitting(value, Sequence, field)
    if count is not None and len(items) != count:
        raise MessageError(f"`{field}` has {len(items)} elements; expected {count}")
    return items


def _write_numbers(out: bytearray, order: str, kind: Number, values: Sequence[Any], field: str) -> None:
    if not values:
        return
    out += b"\0" * (-(len(out) - _HEAD) % kind.size)
    if kind.code not in "?fd":  # numbers of the language are floats
        values = [int(v) if isinstance(v, float) and v.is_integer() else v for v in values]
    try:
        out += struct.pack(f"{order}{len(values)}{kind.code}", *values)
    except (struct.error, OverflowError) as problem:
        raise MessageError(f"`{field}`: {problem}") from None


def _fitting(value: Any, type_: type, field: str) -> Any:
    if not isinstance(value, type_) or (type_ is Sequence and isinstance(value, str)):
        raise MessageError(f"`{field}` is a {type(value).__name__}; expected a {type_.__name__}")
    return value


def _check_length(length: int, bound: int | None, field: str) -> None:
    if bound is not None and length > bound:
        raise MessageError(f"`{field}` has a length of {length}; expected at most {bound}")
