"""Messages survive the way through bytes; bytes that are no message are named, and never crash anything."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import get_args

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.ir.frame import Answer
from colony.runtime.protocol.codec import (
    MAX_MESSAGE_BYTES,
    VERSION,
    MessageFormatError,
    decode,
    decode_all,
    encode,
    max_bytes,
    message_count,
)
from colony.runtime.protocol.messages import (
    MAX_BATCH_LENGTH,
    Alive,
    Announcement,
    Batch,
    Bounds,
    Call,
    Checkpoint,
    Fetch,
    Notice,
    Problem,
    Ready,
    Recall,
    Reply,
    Request,
    Restart,
    Sample,
    SentMessage,
    ServerFrame,
    Tick,
    Verdict,
)

RAW = msgspec.Raw(msgspec.msgpack.encode({"velocity": 200.0}))
MESSAGES: tuple[SentMessage, ...] = (
    Tick(k=3, t_ns=150_000_000, start=1, run="r", down=("PServer",), lost=("drive/avoid",)),
    ServerFrame(server="PServer", k=3, fields={"sonar": Sample((1.5, 2.0), 7), "infrared": None}),
    Fetch(server="PServer", k=2),
    Announcement(k=3, module="learned", answer=Answer((300.0, 5.0))),
    Request(k=3, actuator="drive", client="avoid", bid="command", values=(200.0, True)),
    Bounds(k=3, actuator="drive", low=(None, -60.0), high=(200.0, 60.0)),
    Verdict(k=3, t_ns=5, actuator="drive", by=None, values=None, fates=(("avoid", "late"),), notes=("n",)),
    Ready(client="drive/avoid"),
    Restart(client="drive/avoid", start=1),
    Checkpoint(client="drive/avoid", k=3, start=1, memory=b"\x00\xff"),
    Recall(client="drive/avoid"),
    Call(connection="ann/1", number=1, method="go", arguments=RAW, priority=-2, right="stop"),
    Reply(connection="ann/1", number=1, result=RAW),
    Reply(connection="ann/1", number=1, problem=Problem(code="method", message="no such method")),
    Notice(connection="ann/1", subject="PosX", body=RAW),
    Alive(connection="ann/1"),
)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_round_trip(message: SentMessage) -> None:
    assert decode(encode(message)) == message


def test_every_kind_of_message_is_tried() -> None:
    assert {type(m) for m in MESSAGES} == set(get_args(SentMessage))


@given(st.floats(), st.floats())
def test_doubles_keep_every_bit(a: float, b: float) -> None:
    sent = Request(k=0, actuator="drive", client="c", bid="command", values=(a, b))
    got = decode(encode(sent))
    assert got.values is not None
    for x, y in zip((a, b), got.values, strict=True):
        assert isinstance(y, float)
        assert (math.isnan(x) and math.isnan(y)) or (x == y and math.copysign(1, x) == math.copysign(1, y))


def test_types_stay_apart() -> None:
    got = decode(
        encode(Request(k=0, actuator="a", client="c", bid="command", values=(1.0, True, 0.0, False)))
    )
    assert got.values is not None
    assert [type(v) for v in got.values] == [float, bool, float, bool]


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "found nothing; expected a message of version 1"),
        (b"\x02abc", "found version 2"),
        (bytes([VERSION]) + b"\x93", "truncated"),
        (bytes([VERSION]) + msgspec.msgpack.encode(["Tock", 1]), "Invalid value 'Tock'"),
        (
            bytes([VERSION]) + msgspec.msgpack.encode(["Fetch", "PServer", "soon"]),
            "Expected `int`, got `str`",
        ),
        (bytes([VERSION]) + msgspec.msgpack.encode(["Wake"]), "Invalid value 'Wake'"),
        (bytes([VERSION]) + b"\x91" * 100_000, "."),
        (b"\x01" * (MAX_MESSAGE_BYTES + 1), "expected at most"),
    ],
)
def test_what_is_no_message(data: bytes, why: str) -> None:
    with pytest.raises(MessageFormatError, match=why):
        decode(data)


def read_or_refused(data: bytes) -> None:
    """Nothing but a message, or a reason why there is none, comes of any bytes."""
    with suppress(MessageFormatError):
        assert isinstance(decode(data), get_args(SentMessage))


@given(st.binary(max_size=200))
def test_random_bytes(data: bytes) -> None:
    for candidate in (data, bytes([VERSION]) + data):
        read_or_refused(candidate)


@given(st.sampled_from(MESSAGES), st.integers(0), st.integers(0, 255))
def test_a_bit_gone_wrong(message: SentMessage, place: int, byte: int) -> None:
    data = bytearray(encode(message))
    data[place % len(data)] = byte
    read_or_refused(bytes(data))


def test_what_is_too_large_to_send() -> None:
    with pytest.raises(ValueError, match="Checkpoint"):
        encode(Checkpoint(client="c", k=0, start=0, memory=bytes(2 << 20)))


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_messages_of_frames_are_small_and_each_kind_has_its_limit(message: SentMessage) -> None:
    most = max_bytes(type(message))
    assert most == MAX_MESSAGE_BYTES or most < 2 << 20
    assert (most == MAX_MESSAGE_BYTES) == isinstance(message, (Call, Reply, Notice, Alive))


@pytest.mark.parametrize(
    "message",
    [
        Tick(k=1, t_ns=0, lost=("drive/cruise",) * 100_000),
        ServerFrame(server="S", k=0, fields={"scan": Sample((1.5,) * 40_000, 0)}),
        Request(k=1, actuator="drive", client="c", bid="command", values=(True,) * 70_000),
        Verdict(k=1, t_ns=0, actuator="drive", by=None, values=None, fates=(("c", "won"),) * 200_000),
        Checkpoint(client="c", k=1, start=0, memory=bytes(2 << 20)),
    ],
    ids=lambda m: type(m).__name__,
)
def test_one_that_is_too_large_for_its_kind_is_not_read(message: SentMessage) -> None:
    data = bytes([VERSION]) + msgspec.msgpack.encode(message)
    assert len(data) < MAX_MESSAGE_BYTES
    with pytest.raises(
        MessageFormatError, match=f"{len(data)} bytes; expected at most {max_bytes(type(message))}"
    ):
        decode(data)


def test_a_frame_that_is_too_large_is_not_sent() -> None:
    with pytest.raises(ValueError, match=r"ServerFrame: .* bytes; expected at most 262144"):
        encode(ServerFrame(server="S", k=0, fields={"scan": Sample((1.5,) * 40_000, 0)}))


def other_heads(message: SentMessage | Batch) -> tuple[bytes, ...]:
    """The message in other ways that msgpack has for the same: more elements, a longer head, a longer tag."""
    encoded = msgspec.msgpack.encode(message)
    elements, tag = encoded[0] & 0x0F, encoded[1] & 0x1F
    return tuple(
        bytes([VERSION]) + head + encoded[skip:] + tail
        for head, skip, tail in (
            (bytes([0x90 | (elements + 1)]), 1, b"\xc0"),
            (bytes([0xDC, 0, elements]), 1, b""),
            (bytes([0x90 | elements, 0xD9, tag]), 2, b""),
        )
    )


def test_the_limit_of_a_kind_holds_however_it_is_written() -> None:
    large = ServerFrame(server="S", k=0, fields={"scan": Sample((1.5,) * 40_000, 0)})
    for data in other_heads(large):
        with pytest.raises(MessageFormatError, match="bytes; expected at most"):
            decode(data)


# --- batches ---------------------------------------------------------------------------------------


SAID = (
    Request(k=3, actuator="drive", client="avoid", bid="command", values=(200.0, True)),
    Request(k=3, actuator="light", client="shine", bid="silent"),
    Ready(client="drive/avoid", run="r", k=3),
    Checkpoint(client="drive/avoid", k=3, start=1, memory=b"\x00\xff"),
)


@given(st.lists(st.sampled_from(SAID), min_size=1, max_size=80))
def test_a_batch_comes_back_as_its_messages_and_is_counted_without_reading_it(
    messages: list[Request | Ready | Checkpoint],
) -> None:
    data = encode(Batch(messages=tuple(messages)))
    assert decode_all(data) == tuple(messages)
    assert message_count(data) == len(messages)


@pytest.mark.parametrize("messages", [15, 16, 255, 256, MAX_BATCH_LENGTH])
def test_where_msgpack_writes_lengths_in_another_way_batches_are_counted_right(messages: int) -> None:
    data = encode(Batch(messages=(Ready(client="c"),) * messages))
    assert message_count(data) == len(decode_all(data)) == messages


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_any_other_message_is_one(message: SentMessage) -> None:
    assert message_count(encode(message)) == 1
    assert decode_all(encode(message)) == (message,)


def test_nobody_but_a_transport_reads_batches() -> None:
    with pytest.raises(MessageFormatError, match="Invalid value 'Batch'"):
        decode(encode(Batch(messages=SAID)))


def counted_or_refused(data: bytes) -> None:
    """What comes in counts for as many messages as it has: otherwise a rate could be got around."""
    counted = message_count(data)
    with suppress(MessageFormatError):
        assert len(decode_all(data)) == counted


@given(st.lists(st.sampled_from(SAID), min_size=1, max_size=20), st.data())
def test_a_batch_with_a_bit_gone_wrong_is_counted_right_or_refused(
    messages: list[Request | Ready | Checkpoint], draw: st.DataObject
) -> None:
    data = bytearray(encode(Batch(messages=tuple(messages))))
    data[draw.draw(st.integers(0, len(data) - 1))] = draw.draw(st.integers(0, 255))
    counted_or_refused(bytes(data))
    counted_or_refused(bytes(data[: draw.draw(st.integers(0, len(data)))]))


def test_a_batch_that_is_written_in_another_way_is_refused() -> None:
    batch = Batch(messages=SAID)
    ways = [*other_heads(batch), *(way for way in wider_lengths(batch))]
    for data in ways[:3]:
        with pytest.raises(MessageFormatError, match="cannot be counted"):
            decode_all(data)
    for data in ways:
        counted_or_refused(data)


def wider_lengths(batch: Batch) -> tuple[bytes, ...]:
    """A batch whose number of messages is written in more bytes than needed."""
    number = len(batch.messages)
    head, rest = encode(batch)[: len(encode(Batch(messages=()))) - 1], encode(batch)
    rest = rest[len(head) + 1 :]
    return tuple(
        head + length + rest for length in (b"\xdc" + number.to_bytes(2), b"\xdd" + number.to_bytes(4))
    )


@pytest.mark.parametrize(
    ("batch", "why"),
    [
        (Batch(messages=(Ready(client="c"),) * (MAX_BATCH_LENGTH + 1)), "length <= 1000"),
        (Batch(messages=()), "length >= 1"),
        (Batch(messages=(Fetch(server="S", k=0),)), "Invalid value 'Fetch'"),  # type: ignore[arg-type]
        (Batch(messages=(Batch(messages=SAID),)), "Invalid value 'Batch'"),  # type: ignore[arg-type]
        (Batch(messages=(Ready(client="c" * 1000),) * 400), "bytes; expected at most 65536"),
    ],
    ids=["too many", "none", "another kind", "a batch", "too large"],
)
def test_what_is_no_batch(batch: Batch, why: str) -> None:
    with pytest.raises(MessageFormatError, match=why):
        decode_all(bytes([VERSION]) + msgspec.msgpack.encode(batch))
