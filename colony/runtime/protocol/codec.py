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
    Progress,
    Ready,
    Recall,
    Request,
    Restart,
    SentMessage,
    ServerFrame,
    Stopped,
    Tick,
    Verdict,
    WireMessage,
)

# --- codec ---------------------------------------------------------------------------------------------


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


# --- plausibility --------------------------------------------------------------------------------------
#
# Plausibility checks of messages against the robot's time.
#
# An implausible message counts as malformed, and has no other effect. The Clock numbers at most one frame
# for each `FRAME_NUMBER_NS` of the robot's time (see `clock.py`), so the time limits frame numbers. A
# server that accepted a higher one would ignore all ticks until the Clock reaches it.


FRAME_NUMBER_NS = 100_000
"""Nanoseconds of the robot's time for each frame number, and thus the shortest frame."""

MAX_CLOCK_LEAD_NS = 1_000_000_000
"""Nanoseconds by which a sender's clock may be ahead of this process's clock."""

MAX_ADDRESS_LENGTH = 600
"""Maximum number of characters of an address.

An address has two names of up to 255 characters each: an actuator and a module, or a server and a module
whose activity it relays.
"""

MAX_NAMES = 10_000
"""Maximum number of servers in a tick; also of clients, and of void frames."""

MAX_GAPS = 20
"""Maximum number of gaps in a tick."""


def check_plausible(message: SentMessage, now_ns: int) -> None:
    """Check frame numbers, times and names against what is possible at the robot's time `now_ns`.

    Raises:
        MessageFormatError: the message is implausible.
    """
    match message:
        case Tick():
            _check_tick(message, now_ns)
        case ServerFrame(k=k, server=server, since=since, stopped=stopped):
            _check_frame_number(k, now_ns)
            _check_frame_number(since, now_ns)
            _check_name(server)
            _check_stop(stopped, now_ns)
        case Ready(k=k, client=client, progress=progress):
            _check_frame_number(k, now_ns)
            _check_name(client)
            _check_progress(progress, now_ns)
        case Request(k=k, client=client) | Checkpoint(k=k, client=client):
            _check_frame_number(k, now_ns)
            _check_name(client)
        case (
            Announcement(k=k, module=name)
            | Fetch(k=k, server=name)
            | Verdict(k=k, actuator=name)
            | Bounds(k=k, actuator=name)
        ):
            _check_frame_number(k, now_ns)
            _check_name(name)
        case Restart(start=start, client=client):
            _check_frame_number(start, now_ns)
            _check_name(client)
        case _:
            pass


def _check_tick(tick: Tick, now_ns: int) -> None:
    _check_frame_number(tick.k, now_ns)
    if not 0 <= tick.start <= tick.k:
        raise MessageFormatError(f"frame {tick.k} of an epoch that began at {tick.start}")
    if max(len(tick.down), len(tick.lost), len(tick.void)) > MAX_NAMES:
        raise MessageFormatError(f"more than {MAX_NAMES} servers or clients in a tick")
    least = tick.start
    for previous, first in tick.gaps[:MAX_GAPS]:
        if not least <= previous < first <= tick.k:
            raise MessageFormatError(f"a gap from {previous} to {first} in the tick of frame {tick.k}")
        least = first
    if len(tick.gaps) > MAX_GAPS:
        raise MessageFormatError(f"more than {MAX_GAPS} gaps in a tick")
    if tick.released_ns > now_ns + MAX_CLOCK_LEAD_NS:
        raise MessageFormatError(f"a release at {tick.released_ns} ns, but it is {now_ns} ns now")
    _check_stop(tick.stopped, now_ns)


def _check_progress(progress: Progress | None, now_ns: int) -> None:
    if progress is None:
        return
    _check_frame_number(progress.stepped, now_ns)
    if not 0 <= progress.start <= progress.stepped + 1:
        raise MessageFormatError(f"frame {progress.stepped} of an epoch that began at {progress.start}")
    for tick in progress.ticks:
        _check_tick(tick, now_ns)


def _check_stop(stopped: Stopped | None, now_ns: int) -> None:
    if stopped is not None and stopped.t_ns > now_ns + MAX_CLOCK_LEAD_NS:
        raise MessageFormatError(f"an emergency stop at {stopped.t_ns} ns, but it is {now_ns} ns now")


def _check_frame_number(k: int, now_ns: int) -> None:
    """Check a frame number; -1 stands for no frame."""
    if not -1 <= k <= (now_ns + MAX_CLOCK_LEAD_NS) // FRAME_NUMBER_NS:
        raise MessageFormatError(f"frame {k} is not possible yet")


def _check_name(name: str) -> None:
    if len(name) > MAX_ADDRESS_LENGTH:
        raise MessageFormatError(f"the name `{name[:20]}...` has {len(name)} characters")
