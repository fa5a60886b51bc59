"""Servers that somebody wrote with the kit: the Clock learns from a program that they are read, and tells
everyone when they are down."""

from __future__ import annotations

from colony.runtime.frames.clock import Clock
from colony.runtime.kit.fields import FieldReader, field
from colony.runtime.kit.service import Service
from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Message, QuietNode, Send, ServerFrame, Tick
from colony.runtime.transport.virtual import VirtualClock, VirtualTransport

FRAME_NS = 50_000_000
READS_BATTERY = Deployment(
    run="1", program="p", frame_ns=FRAME_NS, seed=0, actuators=(), servers=("Battery",)
)


def battery() -> Service:
    return Service("Battery", (), FieldReader("Battery", [field("level", lambda: 0.5)], print), report=print)


class Listener(QuietNode):
    """Keeps ticks and frames. Mutable: these."""

    address = "listener"
    listens = (topics.TICKS, topics.frames("Battery"))

    def __init__(self) -> None:
        self.ticks: list[Tick] = []
        self.frames: list[ServerFrame] = []

    def handle(self, message: Message, now_ns: int) -> tuple[Send, ...]:
        if isinstance(message, Tick):
            self.ticks.append(message)
        elif isinstance(message, ServerFrame):
            self.frames.append(message)
        return ()


def test_a_server_that_a_program_reads_is_watched() -> None:
    clock = VirtualClock()
    net, seen = VirtualTransport(clock, seed=0), Listener()
    net.add(seen)
    net.add(battery())
    net.add(Clock(servers=(), frames_kept=40, deployment=READS_BATTERY))
    net.run_until(20 * FRAME_NS)
    assert all(tick.down == () for tick in seen.ticks)
    assert [frame.k for frame in seen.frames] == [tick.k for tick in seen.ticks]
    assert all(frame.fields["level"] is not None for frame in seen.frames)
    net.kill("Battery")
    net.run_until(40 * FRAME_NS)
    assert seen.ticks[-1].down == ("Battery",)
    void = {k for tick in seen.ticks for server, k in tick.void if server == "Battery"}
    answered = {frame.k for frame in seen.frames}
    assert {t.k for t in seen.ticks if "Battery" not in t.down} == answered | void
    net.add(battery())
    net.run_until(60 * FRAME_NS)
    assert seen.ticks[-1].down == ()


def test_a_server_that_no_program_reads_is_not() -> None:
    net, seen = VirtualTransport(VirtualClock(), seed=0), Listener()
    net.add(seen)
    net.add(battery())
    net.add(Clock(servers=(), frames_kept=40))
    net.kill("Battery")
    net.run_until(20 * FRAME_NS)
    assert all(tick.down == () for tick in seen.ticks)
