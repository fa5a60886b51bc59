"""Encoding of a client's memory for checkpoints: msgpack, checked on decoding."""

from __future__ import annotations

import msgspec

from colony.execute.executor import ClientMemory


class MemoryFormatError(ValueError):
    """Bytes that are not a client's memory; the text says what is wrong with them."""


class _Memory(msgspec.Struct, frozen=True, array_like=True):
    first_ns: int | None
    cells: dict[str, float | bool | int]


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(_Memory)


def encode_memory(memory: ClientMemory) -> bytes:
    """Return the memory of a client in msgpack."""
    return _encoder.encode(_Memory(memory.first_ns, memory.cells))


def decode_memory(data: bytes) -> ClientMemory:
    """Return the memory encoded in these bytes.

    Raises:
        MemoryFormatError: the bytes are not a client's memory.
    """
    try:
        memory = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise MemoryFormatError(str(problem) or type(problem).__name__) from None
    return ClientMemory(memory.first_ns, memory.cells)
