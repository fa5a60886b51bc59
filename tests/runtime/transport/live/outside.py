"""Somebody outside a host who sends it bytes, and a node that keeps it busy."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping

import pytest

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import (
    Call,
    Effect,
    Message,
)
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import declare_publisher
from tests.runtime.transport.live.stage import ROBOT, Recorder, robot_address
from tests.waiting import until

SERVER = "RServer"


CALLS = topics.calls(SERVER)


class Outside:
    """Somebody who sends bytes and hears replies."""

    def __init__(self, network: ZenohSession) -> None:
        self.network = network
        self.heard: list[object] = []

    def put(self, key: str, data: bytes) -> None:
        with declare_publisher(self.network.session, f"colony/{ROBOT}/{key}") as publisher:
            until(lambda: publisher.matching_status.matching, f"nobody listens to {key}")  # type: ignore[attr-defined]
            publisher.put(data)

    def call(self, call: Call) -> None:
        self.put(
            keys.publication_key(ROBOT, CALLS, call, user="ada").removeprefix(f"colony/{ROBOT}/"),
            codec.encode(call),
        )

    def hear(self, topic: str) -> None:
        import zenoh

        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self.network.session.declare_subscriber(keys.subscription_key(ROBOT, topic), handler)

    def _take(self, sample: object) -> None:
        self.heard.append(codec.decode(sample.payload.to_bytes()))  # type: ignore[attr-defined]


@pytest.fixture
def outside(environment: Mapping[str, str]) -> Iterator[Outside]:
    with ZenohSession.open(robot_address(environment)) as network:
        yield Outside(network)


class Blocked(Recorder):
    """Handles a first tick for as long as `go` is not set; meanwhile others wait."""

    def __init__(self, then: Callable[[], None] = lambda: None) -> None:
        super().__init__(SERVER, CALLS, topics.TICKS, on=self._block)
        self.busy, self.go = threading.Event(), threading.Event()
        self._then = then

    def _block(self, message: Message, now_ns: int) -> Iterable[Effect]:
        self._then()
        if len(self.got) == 1:
            self.busy.set()
            assert self.go.wait(20)
        return ()
