"""The codec of messages, held to known bytes, to rosbags, and to damage."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import pytest

from colony.ir.ros2_messages import STANDARD, TWIST
from colony.ros2.cdr import Kind, MessageError, Number, Several, Structure, Text, decode, encode, structure

OTHERS = {
    "t/msg/Inner": [("flag", "boolean"), ("number", "int64"), ("name", "string<5>")],
    "t/msg/Outer": [
        ("head", "int8"),
        ("empty", "t/Nothing"),
        ("inner", "t/Inner"),
        ("pair", "t/Inner[2]"),
        ("some", "sequence<t/Inner, 3>"),
        ("bytes", "sequence<uint8>"),
        ("flags", "sequence<boolean>"),
        ("texts", "string[2]"),
        ("shorts", "int16[3]"),
        ("doubles", "sequence<double>"),
    ],
    "t/msg/Nothing": [],
}
KINDS = [structure(name, STANDARD) for name in STANDARD] + [structure("t/msg/Outer", OTHERS)]
NAMES = [kind.name for kind in KINDS]


def drawn(kind: Kind, chance: random.Random) -> Any:
    """Return a value of a kind."""
    match kind:
        case Number(code="?"):
            return chance.random() < 0.5
        case Number(code=("f" | "d") as code):
            value = chance.choice([0.0, math.inf, -math.inf, 1.5, chance.uniform(-9, 9)])
            return value if code == "d" else _single(value)
        case Number(code=code, size=size):
            low = 0 if code.isupper() else -(1 << (8 * size - 1))
            return chance.randrange(low, low + (1 << (8 * size)))
        case Text(bound=bound):
            most = 40 if bound is None else bound
            return "".join(chance.choice("abcé"[: 3 if bound else 4]) for _ in range(chance.randint(0, most)))
        case Several(item=item, count=count, bound=bound):
            size = chance.randint(0, min(bound or 9, 9)) if count is None else count
            found = [drawn(item, chance) for _ in range(size)]
            return bytes(found) if item == Number("B", 1) else tuple(found)
        case Structure(fields=fields):
            return {name: drawn(of, chance) for name, of in fields}


def _single(value: float) -> float:
    import struct

    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def test_a_twist_has_the_bytes_of_other_implementations() -> None:
    values = {"linear": {"x": 0.25}, "angular": {"z": -0.5}}
    found = encode(structure(TWIST, STANDARD), values)
    assert found.hex() == "00010000" + "000000000000d03f" + "00" * 32 + "000000000000e0bf"


@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_message_is_read_as_it_was_written(kind: Structure, order: str) -> None:
    chance = random.Random(f"{kind.name} {order}")
    for _ in range(20):
        values = drawn(kind, chance)
        data = encode(kind, values, order=order)
        assert decode(kind, data) == values
        assert decode(kind, data + b"\0" * 3) == values


@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
def test_a_message_without_values_is_zero_and_empty(kind: Structure) -> None:
    def is_zero(value: Any) -> bool:
        if isinstance(value, Mapping):
            return all(map(is_zero, value.values()))
        if isinstance(value, Sequence):
            return all(map(is_zero, value)) if not isinstance(value, str) else not value
        return not value

    assert is_zero(decode(kind, encode(kind, {})))


def test_rosbags_reads_and_writes_the_same_bytes() -> None:
    typestore = pytest.importorskip("rosbags.typesys")
    store = typestore.get_typestore(typestore.Stores.ROS2_JAZZY)
    chance = random.Random(1)
    for name in STANDARD.keys() - {"std_msgs/msg/Empty"}:
        kind = structure(name, STANDARD)
        for _ in range(20):
            data = encode(kind, drawn(kind, chance))
            assert bytes(store.serialize_cdr(store.deserialize_cdr(data, name), name)) == data, name


@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
def test_a_damaged_message_is_one_error(kind: Structure) -> None:
    chance = random.Random(kind.name)
    for _ in range(200):
        data = bytearray(encode(kind, drawn(kind, chance)))
        for _ in range(chance.randint(0, 4)):
            if data:
                data[chance.randrange(len(data))] = chance.choice([0, 1, 0x7F, 0xFF])
        data = data[: chance.randint(0, len(data))] + chance.randbytes(chance.choice([0, 0, 1, 9]))
        with suppress(MessageError):
            decode(kind, bytes(data))


def test_a_short_message_names_the_field_that_is_missing() -> None:
    kind = structure(TWIST, STANDARD)
    with pytest.raises(MessageError, match=r"`geometry_msgs/msg/Twist` is damaged: 8 bytes missing in `z`"):
        decode(kind, encode(kind, {})[:-8])
    with pytest.raises(MessageError, match="8 bytes left"):
        decode(kind, encode(kind, {}) + b"\0" * 8)


@pytest.mark.parametrize("head", [b"", b"\x00\x01", b"\x00\x03\x00\x00", b"\x00\x07\x00\x00"])
def test_another_encoding_is_refused(head: bytes) -> None:
    with pytest.raises(MessageError, match="expected plain CDR"):
        decode(structure(TWIST, STANDARD), head + b"\0" * 48 * (len(head) > 2))


def test_a_length_that_the_message_has_no_room_for_takes_no_memory() -> None:
    kind = structure("t/msg/Many", {**OTHERS, "t/msg/Many": [("some", "sequence<t/Inner>")]})
    with pytest.raises(MessageError, match="4294967295 elements"):
        decode(kind, b"\x00\x01\x00\x00\xff\xff\xff\xff")


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"head": 200}, "`head`: "),
        ({"head": 0.5}, "`head`: "),
        ({"nose": 1}, "has no field `nose`"),
        ({"inner": 3}, "`inner` is a int; expected a Mapping"),
        ({"inner": {"name": "sixsix"}}, "`name` has a length of 6; expected at most 5"),
        ({"pair": [{}]}, "`pair` has 1 elements; expected 2"),
        ({"some": [{}] * 4}, "`some` has a length of 4; expected at most 3"),
        ({"texts": "ab"}, "`texts` is a str; expected a Sequence"),
    ],
)
def test_a_value_that_does_not_fit_is_an_error(values: dict[str, Any], why: str) -> None:
    with pytest.raises(MessageError, match=why):
        encode(structure("t/msg/Outer", OTHERS), values)


def test_numbers_of_the_language_fit_whole_numbers() -> None:
    kind = structure("std_msgs/msg/Int32", STANDARD)
    assert decode(kind, encode(kind, {"data": 3.0})) == {"data": 3}


@pytest.mark.parametrize(
    ("definitions", "why"),
    [
        ({}, "the definition of `a/msg/A` is missing"),
        ({"a/msg/A": [("b", "wstring")]}, "`wstring` is not supported"),
        ({"a/msg/A": [("b", "a/A")]}, "nests too deep"),
    ],
)
def test_a_definition_that_cannot_be_read_is_an_error(definitions: Any, why: str) -> None:
    with pytest.raises(MessageError, match=why):
        structure("a/msg/A", definitions)
