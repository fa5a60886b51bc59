"""The largest messages of every kind, most of them beyond their kind's limit: how long a server is busy with
one, and whether an emergency stop gets through right behind it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
import zenoh

from colony.runtime.kit.connection import Session
from colony.runtime.kit.emergency import StopButton
from colony.runtime.library import clock, data
from colony.runtime.library.ask import STATUS
from colony.runtime.protocol.calls import Open
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES, VERSION
from colony.runtime.protocol.messages import (
    MAX_BATCH_LENGTH,
    Batch,
    Call,
    Checkpoint,
    Fetch,
    Request,
    Sample,
    SentMessage,
    ServerFrame,
    Tick,
    Verdict,
)
from tests.cli.machine import ROBOT

SERVERS = ("RServer", "Clock", "DServer")
PATIENCE_S = 60.0
ROOM = 2048
"""Bytes of a message besides what makes it large."""


class Weight(NamedTuple):
    """A message: the server and what it is, its key below the robot's, and its bytes."""

    server: str
    name: str
    key: str
    data: bytes


class Borne(NamedTuple):
    """What came of one: seconds until the server answered a call behind it, and a stop behind that."""

    weight: Weight
    answer_s: float
    stop_s: float


def weights(user: str) -> Iterator[Weight]:
    """The largest messages of each kind, at each server."""
    for server in SERVERS:
        yield from _calls(server, f"{user}/heavy")
        for name, topic, message in _frames(server):
            yield Weight(
                server, name, f"{topic}/{user}" if topic.startswith(server) else topic, _bytes(message)
            )
    yield Weight("DServer", "set_many", *_call("DServer", f"{user}/heavy", 2, "set_many", _many(900)))
    yield Weight(
        "DServer", "watch", *_call("DServer", f"{user}/heavy", 3, "watch", data.watch("x").arguments)
    )


def _calls(server: str, connection: str) -> Iterator[Weight]:
    yield Weight(server, "open", *_call(server, connection, 1, "open", Open(name="heavy")))
    raw = {
        "deploy, 4 MiB of numbers": ("deploy", [0] * (MAX_MESSAGE_BYTES - ROOM)),
        "deploy, 4 MiB of maps": ("deploy", [{}] * (MAX_MESSAGE_BYTES - ROOM)),
        "status, 4 MiB": ("status", [0] * (MAX_MESSAGE_BYTES - ROOM)),
        "set, 4 MiB": ("set", {"name": "x", "value": bytes(MAX_MESSAGE_BYTES - ROOM)}),
        "set_many, 4 MiB": ("set_many", {"values": {f"{i:05}": i for i in range(400_000)}}),
        "no such method": ("x" * (MAX_MESSAGE_BYTES - ROOM), None),
    }
    for number, (name, (method, arguments)) in enumerate(raw.items(), start=10):
        yield Weight(server, name, *_call(server, connection, number, method, arguments))
    yield Weight(
        server,
        "deep",
        f"{server}/call/command/{connection}",
        bytes([VERSION]) + b"\x91" * (MAX_MESSAGE_BYTES - 1),
    )


def _frames(server: str) -> Iterator[tuple[str, str, SentMessage | Batch]]:
    yield (
        "request",
        f"{server}/requests",
        Request(k=1, actuator="d", client="c", bid="command", values=(True,) * 4_000_000),
    )
    asking = Request(k=1, actuator="d", client="c", bid="silent")
    yield "batch", f"{server}/requests", Batch(messages=(asking,) * 200_000)
    yield "batch of many", f"{server}/requests", Batch(messages=(asking,) * MAX_BATCH_LENGTH)
    yield "fetch", f"{server}/fetches", Fetch(server="x" * 4_000_000, k=1)
    yield "tick", "Clock/ticks", Tick(k=1 << 62, t_ns=0, lost=("ab",) * 1_300_000)
    yield "tick that cannot be", "Clock/ticks", Tick(k=1 << 62, t_ns=0)
    yield (
        "verdict",
        "verdicts",
        Verdict(k=1, t_ns=0, actuator="d", by=None, values=None, fates=(("m", "won"),) * 590_000),
    )
    fields = {f"{i:05}": Sample(True, 0) for i in range(90_000)}
    yield "frame", "RServer/frames", ServerFrame(server="RServer", k=1, fields=fields)
    yield (
        "checkpoint",
        f"{server}/checkpoints",
        Checkpoint(client="c", k=1, start=0, memory=bytes(MAX_MESSAGE_BYTES - ROOM)),
    )


def _many(number: int) -> object:
    return {"values": {f"heavy{i}": 1.5 for i in range(number)}}


def _call(server: str, connection: str, number: int, method: str, arguments: object) -> tuple[str, bytes]:
    raw = msgspec.Raw(msgspec.msgpack.encode(arguments))
    call = Call(connection=connection, number=number, method=method, arguments=raw)
    return f"{server}/call/command/{connection}", _bytes(call)


def _bytes(message: SentMessage | Batch) -> bytes:
    """The bytes of a message, also of one that is too large for its kind; as much as goes into the
    largest."""
    return (bytes([VERSION]) + msgspec.msgpack.encode(message))[:MAX_MESSAGE_BYTES]


def bear(home: Session, weight: Weight, button: StopButton) -> Borne:
    """Send one, from the robot's own machine, and see how soon the server answers what comes behind it."""
    with home.connect(weight.server, timeout_s=PATIENCE_S) as connection:
        connection.do(STATUS)
        begin = time.monotonic()
        _send(home, weight)
        connection.do(STATUS)
        answer_s = time.monotonic() - begin
    _send(home, weight)
    begin = time.monotonic()
    pressed = button.press()
    stop_s = time.monotonic() - begin
    assert pressed.kept, pressed.problems
    with home.connect("Clock", timeout_s=PATIENCE_S) as at_clock:
        at_clock.do(clock.release())
    return Borne(weight, answer_s, stop_s)


def _send(home: Session, weight: Weight) -> None:
    home.hub.network.session.put(
        f"colony/{ROBOT}/{weight.key}",
        weight.data,
        priority=zenoh.Priority.REAL_TIME,
        congestion_control=zenoh.CongestionControl.BLOCK,
    )
