"""Encoding of messages: one version byte, then msgpack. Incoming messages are checked against the types.

`decode` raises `MessageFormatError` for a message that is too large, of another version, or malformed. The
error says what was found, where, and what was expected.
"""

from __future__ import annotations

from typing import TypeVar, get_args

import msgspec

from colony.runtime.protocol.messages import (
    Announcement,
    Batch,
    Bounds,
    Checkpoint,
    Fetch,
    Ready,
    Recall,
    Request,
    Restart,
    SentMessage,
    ServerFrame,
    Tick,
    Verdict,
    WireMessage,
)

VERSION = 1
"""Version of the protocol.

Once a version is released, a field with a default may be added at the end of a message; every other change
needs a new version.
"""

MAX_MESSAGE_BYTES = 4 * 1024 * 1024
"""Byte limit of a message: enough for a color image of 1280x960 and its metadata."""

_MAX_BYTES: dict[type, int] = {
    **dict.fromkeys((Tick, Verdict, Checkpoint, Recall), 1024 * 1024 + 65_536),
    ServerFrame: 256 * 1024,
    **dict.fromkeys((Batch, Request, Bounds, Announcement, Fetch, Ready, Restart), 65_536),
}
"""Byte limits of the messages that every frame consists of.

They are smaller, because decoding many small values in every frame would take too long.
"""

_MAX_BYTES_BY_TAG = {
    msgspec.msgpack.encode(kind.__name__): _MAX_BYTES.get(kind, MAX_MESSAGE_BYTES)
    for kind in get_args(WireMessage)
}
"""Byte limits by tag; the tag of a message is the name of its type, in msgpack."""

_TAG_OFFSET = 2
"""Offset of the tag in a message, after the version and the length of the array."""


def max_bytes(kind: type) -> int:
    """Return the byte limit for messages of a type."""
    return _MAX_BYTES.get(kind, MAX_MESSAGE_BYTES)


_PREFIX = bytes([VERSION])

_BATCH_START = _PREFIX + b"\x92" + msgspec.msgpack.encode("Batch")
"""First bytes of every batch: the start of an array of two (tag and messages), and the tag."""

T = TypeVar("T")


class MessageFormatError(ValueError):
    """Bytes that are not a message of this version; the text says what is wrong with them."""


_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[SentMessage] = msgspec.msgpack.Decoder(SentMessage)
_batch_decoder: msgspec.msgpack.Decoder[WireMessage] = msgspec.msgpack.Decoder(WireMessage)


def encode(message: WireMessage) -> bytes:
    """Encode a message.

    Raises:
        ValueError: the message exceeds the limit of its type.
    """
    data = _PREFIX + _encoder.encode(message)
    limit = max_bytes(type(message))
    if len(data) > limit:
        raise ValueError(f"{type(message).__name__}: {len(data)} bytes; expected at most {limit}")
    return data


def decode(data: bytes) -> SentMessage:
    """Decode a message.

    Raises:
        MessageFormatError: the bytes are not a message, or exceed the limit of its type.
    """
    return _decode(data, _decoder)


def decode_all(data: bytes) -> tuple[SentMessage, ...]:
    """Decode a message, or the messages of a batch.

    Raises:
        MessageFormatError: the bytes are neither, or exceed the limit of their type.
    """
    message = _decode(data, _batch_decoder)
    if not isinstance(message, Batch):
        return (message,)
    if message_count(data) != len(message.messages):  # `message_count` knows only the shortest form
        raise MessageFormatError(
            "the length of the batch cannot be counted: it is not encoded in the shortest form"
        )
    return message.messages


def message_count(data: bytes) -> int:
    """Return the number of messages that these bytes claim to contain, without decoding them; at least 1."""
    if not data.startswith(_BATCH_START):
        return 1
    head = data[len(_BATCH_START) : len(_BATCH_START) + 5]
    match head[:1]:
        case b"\xdc":
            claimed_count = int.from_bytes(head[1:3], "big")
        case b"\xdd":
            claimed_count = int.from_bytes(head[1:5], "big")
        case _:
            claimed_count = head[0] & 0x0F if head else 1
    return max(1, claimed_count)


def _decode(data: bytes, decoder: msgspec.msgpack.Decoder[T]) -> T:
    if len(data) > (limit := _max_bytes_of(data)):
        raise MessageFormatError(f"{len(data)} bytes; expected at most {limit}")
    if data[:1] != _PREFIX:
        found = f"version {data[0]}" if data else "nothing"
        raise MessageFormatError(f"found {found}; expected a message of version {VERSION}")
    try:
        return decoder.decode(memoryview(data)[1:])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise MessageFormatError(str(problem) or type(problem).__name__) from None


def _max_bytes_of(data: bytes) -> int:
    """Return the byte limit for messages that begin like these bytes.

    A message whose tag is not where `encode` puts it gets the smallest limit.
    """
    if len(data) <= _SMALLEST_LIMIT:
        return _SMALLEST_LIMIT
    tag = data[
        _TAG_OFFSET : _TAG_OFFSET + 1 + (data[_TAG_OFFSET] & 0x1F)
    ]  # a msgpack fixstr and its length byte
    return _MAX_BYTES_BY_TAG.get(tag, _SMALLEST_LIMIT)


_SMALLEST_LIMIT = min(_MAX_BYTES.values())
