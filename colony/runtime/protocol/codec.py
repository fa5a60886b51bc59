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

Once a version is released, a field with a default may be added at the end of a message; every other change is
a new version.
"""

MAX_MESSAGE_BYTES = 4 * 1024 * 1024
"""Byte limit of a message: enough for a color image of 1280x960 and its metadata."""

_MAX_BYTES: dict[type, int] = {
    **dict.fromkeys((Tick, Verdict, Checkpoint, Recall), 1024 * 1024 + 65_536),
    ServerFrame: 256 * 1024,
    **dict.fromkeys((Batch, Request, Announcement, Fetch, Ready, Restart), 65_536),
}
"""Byte limits of the kinds of messages that make up frames.

They are smaller because many small values take long to decode, in every frame.
"""

_MAX_BYTES_BY_TAG = {
    msgspec.msgpack.encode(kind.__name__): _MAX_BYTES.get(kind, MAX_MESSAGE_BYTES)
    for kind in get_args(WireMessage)
}
"""Byte limits of all kinds by tag, which is the name of the kind in msgpack."""

_TAG_AT = 2
"""Index of the tag in a message, after the version and the length of the array."""


def max_bytes(kind: type) -> int:
    """Return the byte limit for messages of a kind."""
    return _MAX_BYTES.get(kind, MAX_MESSAGE_BYTES)


_PREFIX = bytes([VERSION])

_BATCH = _PREFIX + b"\x92" + msgspec.msgpack.encode("Batch")
"""First bytes of every batch: an array of two, its tag and its messages."""

T = TypeVar("T")


class MessageFormatError(ValueError):
    """Bytes that are not a message of this version; the text says what is wrong with them."""


_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[SentMessage] = msgspec.msgpack.Decoder(SentMessage)
_decoder_of_all: msgspec.msgpack.Decoder[WireMessage] = msgspec.msgpack.Decoder(WireMessage)


def encode(message: WireMessage) -> bytes:
    """Encode a message.

    Raises:
        ValueError: the message exceeds the limit of its kind.
    """
    data = _PREFIX + _encoder.encode(message)
    most = max_bytes(type(message))
    if len(data) > most:
        raise ValueError(f"{type(message).__name__}: {len(data)} bytes; expected at most {most}")
    return data


def decode(data: bytes) -> SentMessage:
    """Decode a message.

    Raises:
        MessageFormatError: the bytes are not a message, or exceed the limit of its kind.
    """
    return _decoded(data, _decoder)


def decode_all(data: bytes) -> tuple[SentMessage, ...]:
    """Decode a message, or the messages of a batch.

    Raises:
        MessageFormatError: the bytes are neither, or exceed the limit of their kind.
    """
    found = _decoded(data, _decoder_of_all)
    if not isinstance(found, Batch):
        return (found,)
    if count(data) != len(found.messages):  # `count` knows only the shortest form
        raise MessageFormatError(
            "the length of the batch cannot be counted: it is not encoded in the shortest form"
        )
    return found.messages


def count(data: bytes) -> int:
    """Return the number of messages that these bytes claim to hold, without decoding them; at least 1."""
    if not data.startswith(_BATCH):
        return 1
    head = data[len(_BATCH) : len(_BATCH) + 5]
    match head[:1]:
        case b"\xdc":
            claimed = int.from_bytes(head[1:3], "big")
        case b"\xdd":
            claimed = int.from_bytes(head[1:5], "big")
        case _:
            claimed = head[0] & 0x0F if head else 1
    return max(1, claimed)


def _decoded(data: bytes, decoder: msgspec.msgpack.Decoder[T]) -> T:
    if len(data) > (most := _max_bytes_of(data)):
        raise MessageFormatError(f"{len(data)} bytes; expected at most {most}")
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
    tag = data[_TAG_AT : _TAG_AT + 1 + (data[_TAG_AT] & 0x1F)]  # a short string of msgpack, with its length
    return _MAX_BYTES_BY_TAG.get(tag, _SMALLEST_LIMIT)


_SMALLEST_LIMIT = min(_MAX_BYTES.values())
