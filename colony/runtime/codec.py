"""Messages as bytes: one byte of version, then msgpack. What comes in is checked against the types.

A message that is too large, of another version, or not of its type is never half-read: `decode` raises
`NotAMessage`, which says what was found, where, and what was expected.
"""

from __future__ import annotations

import msgspec

from colony.runtime.messages import Call, Checkpoint, Notice, Reply, Sent, ServerFrame

VERSION = 1
"""Of the protocol. A field with a default may be added at the end of a message; all else is a new version."""

LARGEST = 4 * 1024 * 1024
"""Bytes of the largest message: a color image of 1280x960 and something."""

LARGEST_OF_NUMBERS = 256 * 1024
"""Bytes of the largest message of a kind that carries no values of any size: each of its numbers and names
becomes an object of its own, and four megabytes of those take a sixth of a second."""

_PREFIX = bytes([VERSION])

_CARRYING_VALUES = tuple(
    msgspec.msgpack.encode(kind.__name__) for kind in (ServerFrame, Checkpoint, Call, Reply, Notice)
)
"""The kinds of messages that may have `LARGEST` bytes, as their bytes name them."""


class NotAMessage(ValueError):
    """These bytes are no message of this version; the text says what is wrong with them."""


_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[Sent] = msgspec.msgpack.Decoder(Sent)


def encode(message: Sent) -> bytes:
    """A message in bytes.

    Raises:
        ValueError: it would be larger than `LARGEST`, or than `LARGEST_OF_NUMBERS` for most kinds.
    """
    data = _PREFIX + _encoder.encode(message)
    if len(data) > LARGEST_OF_NUMBERS and len(data) > (most := _largest(data)):
        raise ValueError(f"{type(message).__name__}: {len(data)} bytes; expected at most {most}")
    return data


def decode(data: bytes) -> Sent:
    """The message in these bytes.

    Raises:
        NotAMessage: there is none.
    """
    if len(data) > LARGEST_OF_NUMBERS and len(data) > (most := _largest(data)):
        raise NotAMessage(f"{len(data)} bytes; expected at most {most}")
    if data[:1] != _PREFIX:
        found = f"version {data[0]}" if data else "nothing"
        raise NotAMessage(f"found {found}; expected a message of version {VERSION}")
    try:
        return _decoder.decode(memoryview(data)[1:])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise NotAMessage(str(problem) or type(problem).__name__) from None


def _largest(data: bytes) -> int:
    """How large a message may be, by its first bytes: the version, the length of the array, the kind."""
    carries = len(data) > LARGEST or data[2:20].startswith(_CARRYING_VALUES)
    return LARGEST if carries else LARGEST_OF_NUMBERS
