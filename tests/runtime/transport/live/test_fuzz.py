"""The servers of a robot as processes, under fire from the network: all of them live, answer, and keep their
memory, and the robot stands where it stood."""

from __future__ import annotations

import os
from collections import Counter
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest
import zenoh

from colony.runtime.kit.connection import Session
from colony.runtime.library import clock as clock_library
from colony.runtime.library import proximity, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.calls import NoArguments, Status
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES, MessageFormatError
from colony.runtime.protocol.messages import Reply, Right, SentMessage, Tick
from colony.runtime.transport.live.inbox import MAX_SLEEP_S, Inbox, MessageQueue
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import declare_publisher
from colony.runtime.transport.live.robot_address import local
from tests.cli.machine import MAP, ROBOT, Machine
from tests.runtime.servers.fuzz_stage import BUILD, Stage
from tests.waiting import until

SEED = 1994
SALVO = 1500
"""Messages, of which there are three salvos; the first one warms up."""

GROWTH = 16 << 20
"""Bytes by which a server may be larger after the last salvo than after the first."""


class Gun(Stage):
    """What a `Stage` would give to its server goes over the network to the one of the same name.

    Mutable: what was fired.
    """

    def __init__(self, name: str, network: ZenohSession, random: Random) -> None:
        self.network = network
        self.fired = 0
        rights: tuple[Right, ...] = ("read", "stop") if name == "RServer" else ("read", "command", "stop")
        super().__init__(BUILD[name](), random, rights=rights)

    def frame(self, topic: str, data: bytes) -> None:
        """Anything but what a Clock would say: who can speak in its place is believed."""
        try:
            forged = topic == topics.TICKS and isinstance(codec.decode(data), Tick)
        except MessageFormatError:
            forged = False
        if not forged:
            self.fire(f"colony/{ROBOT}/{topic}", data)

    def call(self, right: Right, connection: str, data: bytes) -> list[SentMessage]:
        self._numbers[connection] += 1
        server = self.node.address
        self.fire(f"colony/{ROBOT}/{topics.calls(server)}/{right}/{connection}", data)
        return []

    def fire(self, key: str, data: bytes) -> None:
        self.fired += 1
        self.network.session.put(
            key, data, congestion_control=zenoh.CongestionControl.BLOCK, priority=zenoh.Priority.DATA
        )


def resident(pid: int) -> int:
    """Bytes of a process in memory."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")


def healthy(session: Session) -> None:
    """Every server answers a call that nothing is wrong with."""
    for name in BUILD:
        with session.connect(name, name="doctor") as connection:
            found: Status = connection.do(
                CallRequest("status", NoArguments(), Status, "read", repeatable=True)
            )
            assert found.server == name
    with session.connect("PServer", name="doctor") as eye:
        until(lambda: eye.do(proximity.sonar()), "the sonars read")


@pytest.mark.long
def test_servers_under_fire(machine: Machine) -> None:
    print(f"seed {SEED}")
    served = machine.start("serve", "all", "--robot", ROBOT, "--map", MAP, "--camera", "0")
    until(lambda: served.ended() or len(machine.directory.running()) == 8, "all of them are there")
    until(machine.truth, "the plant answers")
    random, said = Random(SEED), Counter[str]()

    def hear(sample: zenoh.Sample) -> None:
        with suppress(MessageFormatError):  # what was fired at all keys comes back here
            reply = codec.decode(sample.payload.to_bytes())
            if isinstance(reply, Reply):
                said[reply.problem.code if reply.problem is not None else "done"] += 1

    with machine.session() as session, ZenohSession.open(local(ROBOT, machine.environment)) as network:
        until(lambda: set(BUILD) <= set(network.alive()), "all of them are found")
        handler = zenoh.handlers.Callback(hear, indirect=False)
        network.session.declare_subscriber(f"colony/{ROBOT}/*/reply/*/*", handler)
        healthy(session)
        pids = dict(machine.directory.running())
        guns = [Gun(name, network, random) for name in BUILD]
        sizes: list[dict[str, int]] = []
        for _ in range(3):
            for _ in range(SALVO):
                random.choice(guns).anything()
            _cannonballs(network)
            healthy(session)
            truth = machine.truth()
            assert (truth.velocity, truth.turn, truth.distance) == (0.0, 0.0, 0.0)
            assert dict(machine.directory.running()) == pids, served.err
            sizes.append({name: resident(pid) for name, pid in pids.items()})
        grown = {name: sizes[-1][name] - sizes[0][name] for name in pids}
        print(f"{sum(g.fired for g in guns)} messages; grown by KiB:", {n: s >> 10 for n, s in grown.items()})
        print(f"said: {dict(said)}")
        assert max(grown.values()) < GROWTH
        assert min(said[code] for code in ("done", "malformed", "arguments", "closed", "right")) > 10
        _drives(machine, session)
    assert served.err.count("Traceback") == 0


def _cannonballs(network: ZenohSession) -> None:
    """What is too large, or comes on keys where nobody should speak."""
    huge = bytes([1]) + bytes(MAX_MESSAGE_BYTES)
    for key in (
        f"colony/{ROBOT}/RServer/call/read/ada/1",
        f"colony/{ROBOT}/DServer/requests/ada",
        f"colony/{ROBOT}/{topics.TICKS}",
    ):
        with declare_publisher(network.session, key) as publisher:
            publisher.put(huge)
    for key in ("**", "*/call/command/*/*", "RServer/call/*/*/*", "RServer/**", "DServer/call/up/ada/1"):
        network.session.put(f"colony/{ROBOT}/{key}", b"\x01\x93\xa4Call")


def _drives(machine: Machine, session: Session) -> None:
    """After all of this the robot goes where somebody sends it who may."""
    with session.connect("Clock") as clock, session.connect("RServer", name="driver", priority=77) as base:

        def released() -> bool:
            clock.do(clock_library.release())
            return base.do(robot.arbitration()).stopped is None

        until(released, "a tick brings the release to RServer, and no stop that was fired comes after it")
        base.do(robot.turn(20.0))
    truth = machine.truth()
    assert truth.bumps == 0


def test_who_sleeps_for_ever_is_woken_in_between() -> None:
    inbox = Inbox(MessageQueue())
    inbox.rouse()
    inbox.sleep(1e12)
    assert MAX_SLEEP_S < 1e6
