"""What clients of one process say to one server travels in one piece: split where it is too much, counted for
what it is, and taken as a whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import msgspec
import pytest
import zenoh

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import (
    MAX_BATCH_LENGTH,
    Batch,
    Checkpoint,
    Malformed,
    Ready,
    Recall,
    Request,
    SendMessage,
    SentMessage,
    Verdict,
)
from colony.runtime.transport.live import keys, limits
from colony.runtime.transport.live.limits import PROGRAM_RATE, Rate, RateLimits
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import MAX_BATCHED_BYTES, Outbox
from tests.runtime.transport.live.outside import SERVER, Outside
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted, robot_address
from tests.waiting import until

REQUESTS = topics.requests(SERVER)
SAVED = topics.checkpoints("DServer")


def asks(k: int, client: str = "avoid") -> Request:
    return Request(k=k, actuator="drive", client=client, bid="silent")


def ready(client: str = "drive/avoid") -> Ready:
    return Ready(client=client, run="run", k=3)


def memory(client: str, size: int) -> Checkpoint:
    return Checkpoint(client=client, k=3, start=0, memory=bytes(size))


# --- on their way out ------------------------------------------------------------------------------


class WireMessage:
    """An outbox, and all that leaves it, by topic: the pieces, each with its messages."""

    def __init__(self, network: ZenohSession) -> None:
        self.reports: list[str] = []
        self.box = Outbox(network.session, ROBOT, self.reports.append, user="u")
        self.pieces: list[tuple[str, tuple[SentMessage, ...]]] = []
        for topic in (REQUESTS, SAVED, topics.READY, topics.VERDICTS):
            handler = zenoh.handlers.Callback(self._taker(topic), indirect=False)
            network.session.declare_subscriber(keys.subscription_key(ROBOT, topic), handler)

    def _taker(self, topic: str) -> Callable[[zenoh.Sample], None]:
        return lambda sample: self.pieces.append((topic, codec.decode_all(sample.payload.to_bytes())))

    def send(self, *sends: SendMessage) -> list[tuple[str, tuple[SentMessage, ...]]]:
        """Send these; gives the pieces in which they were heard."""
        self.pieces.clear()
        self.box.send_all(sends, 0)
        until(lambda: sum(len(piece) for _, piece in self.pieces) == len(sends), "all is heard")
        return self.pieces


@pytest.fixture
def wire(environment: Mapping[str, str]) -> Iterator[WireMessage]:
    with ZenohSession.open(robot_address(environment)) as network:
        yield WireMessage(network)


def test_what_is_said_to_one_server_goes_in_one_piece_and_all_else_by_itself(wire: WireMessage) -> None:
    verdicts = [Verdict(k=k, t_ns=0, actuator="drive", by=None, values=None, fates=()) for k in (1, 2)]
    sent = [
        SendMessage(REQUESTS, asks(3, "avoid")),
        *(SendMessage(topics.VERDICTS, verdict) for verdict in verdicts),
        SendMessage(topics.READY, ready("drive/avoid")),
        SendMessage(REQUESTS, asks(3, "cruise")),
        SendMessage(SAVED, memory("drive/avoid", MAX_BATCHED_BYTES)),
        SendMessage(SAVED, memory("drive/cruise", 10)),
        SendMessage(SAVED, memory("drive/large", MAX_BATCHED_BYTES + 1)),
        SendMessage(SAVED, Recall(client="drive/new")),
    ]
    assert sorted(wire.send(*sent), key=repr) == sorted(
        [
            *((topics.VERDICTS, (verdict,)) for verdict in verdicts),
            (REQUESTS, (asks(3, "avoid"), asks(3, "cruise"))),
            (topics.READY, (ready("drive/avoid"),)),
            (SAVED, (memory("drive/avoid", MAX_BATCHED_BYTES), memory("drive/cruise", 10))),
            (SAVED, (memory("drive/large", MAX_BATCHED_BYTES + 1),)),
            (SAVED, (Recall(client="drive/new"),)),
        ],
        key=repr,
    )


def test_more_than_fit_into_a_batch_go_in_several_and_in_their_order(wire: WireMessage) -> None:
    sent = [asks(k) for k in range(MAX_BATCH_LENGTH + 1)]
    pieces = [piece for _, piece in wire.send(*(SendMessage(REQUESTS, one) for one in sent))]
    assert [len(piece) for piece in pieces] == [MAX_BATCH_LENGTH, 1]
    assert [one for piece in pieces for one in piece] == sent
    assert not wire.reports


def test_what_is_too_large_together_goes_one_by_one(wire: WireMessage) -> None:
    large = [asks(k, "c" * 60_000) for k in range(6)]
    assert wire.send(*(SendMessage(REQUESTS, one) for one in large)) == [(REQUESTS, (one,)) for one in large]
    assert not wire.reports


# --- on their way in -------------------------------------------------------------------------------


def test_a_batch_costs_as_much_as_its_messages_alone() -> None:
    counting = RateLimits("here", monotonic=lambda: 0)
    burst = int(PROGRAM_RATE.burst)
    assert not counting.admit_frame("requests", "ada", 50, burst + 1)
    assert counting.admit_frame("requests", "ada", 50, burst - 1), "what was refused cost nothing"
    assert not counting.admit_frame("requests", "ada", 50, 2)
    assert counting.admit_frame("requests", "ada", 50)
    assert not counting.admit_frame("requests", "ada", 50)
    assert counting.admit_frame("requests", "bob", 50, burst)
    assert all(counting.admit_frame("requests", "here", 50, burst) for _ in range(3))


def put(outside: Outside, data: bytes, user: str = "ada") -> None:
    outside.put(f"{REQUESTS}/{user}", data)


def test_a_batch_over_the_rate_of_its_user_is_refused_as_a_whole(
    environment: Mapping[str, str], outside: Outside, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "PROGRAM_RATE", Rate(per_s=0.0, burst=7.0))
    node = Recorder(SERVER, REQUESTS)
    batches = [tuple(asks(k) for k in ks) for ks in (range(4), range(10, 14), range(20, 23))]
    with hosted(environment, [node]):
        for batch in batches:
            put(outside, codec.encode(Batch(messages=batch)))
        put(outside, codec.encode(asks(30)))
        put(outside, codec.encode(asks(31)), user="bob")
        until(lambda: asks(31) in node.got, "another user is heard")
    assert node.got == [*batches[0], *batches[2], asks(31)]


def of(*messages: object) -> bytes:
    """A batch of anything."""
    return bytes([codec.VERSION]) + msgspec.msgpack.encode(["Batch", messages])


GOOD = ("Request", 3, "drive", "avoid", "command", (200.0, 0.0), None)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (of(GOOD, ("Request", "now", "drive", "avoid", "silent")), "Expected `int`"),
        (of(GOOD, ("Ready", "drive/avoid", "run", 3)), "found Ready"),
        (of(GOOD, ("Call", "ada/1", 1, "go", {})), "Invalid value 'Call'"),
        (of(GOOD, ("Request", 1 << 62, "drive", "avoid", "silent")), "is not possible yet"),
        (of(*[GOOD] * (MAX_BATCH_LENGTH + 1)), "length <= 1000"),
        (of(*[GOOD] * 20)[:-5], "truncated"),
        (b"\x01\xdc\x00\x02" + of(GOOD, GOOD)[2:], "shortest form"),
    ],
    ids=["a type", "elsewhere", "a call", "implausible", "too many", "cut off", "another head"],
)
def test_of_a_batch_with_anything_wrong_in_it_nothing_is_taken(
    environment: Mapping[str, str], outside: Outside, data: bytes, says: str
) -> None:
    node = Recorder(SERVER, REQUESTS)
    with hosted(environment, [node]):
        put(outside, data)
        put(outside, codec.encode(Batch(messages=(asks(4), asks(5)))))
        until(lambda: asks(5) in node.got, "what comes after it is heard")
    malformed, *rest = node.got
    assert isinstance(malformed, Malformed)
    assert says in malformed.reason
    assert rest == [asks(4), asks(5)]
