"""The memory of a client goes into bytes and back; other bytes are refused, and never a traceback."""

from __future__ import annotations

import contextlib
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.execute.executor import ClientMemory
from colony.runtime.clients.client import MemoryFormatError, decode_memory, encode_memory

CELLS = st.dictionaries(
    st.text(max_size=10), st.floats() | st.booleans() | st.integers(-(2**63), 2**63 - 1), max_size=5
)


@given(st.none() | st.integers(-(2**63), 2**63 - 1), CELLS)
def test_there_and_back(first_ns: int | None, cells: dict[str, float | bool | int]) -> None:
    memory = ClientMemory(first_ns, cells)
    assert repr(decode_memory(encode_memory(memory))) == repr(memory)


def test_kinds_stay_apart() -> None:
    cells: dict[str, float | bool | int] = {"a": 1.0, "b": True, "c": 1, "d": -0.0, "e": math.nan}
    back = decode_memory(encode_memory(ClientMemory(5, cells))).cells
    assert [type(v) for v in back.values()] == [float, bool, int, float, float]
    assert math.copysign(1.0, back["d"]) == -1.0


BAD = [
    b"",
    b"\xc1",
    msgspec.msgpack.encode(None),
    msgspec.msgpack.encode([1]),
    msgspec.msgpack.encode(["now", {}]),
    msgspec.msgpack.encode([1, {"a": "text"}]),
    msgspec.msgpack.encode([1, {"a": None}]),
    msgspec.msgpack.encode([1, {1: 1.0}]),
    b"\x92\x01\x81\xa2\xff\xfe\x01",
    b"\x91" * 10_000,
]


@pytest.mark.parametrize("data", BAD)
def test_other_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(MemoryFormatError) as refused:
        decode_memory(data)
    assert str(refused.value)


@given(st.binary(max_size=40))
def test_any_bytes_are_memory_or_refused(data: bytes) -> None:
    with contextlib.suppress(MemoryFormatError):
        decode_memory(data)
