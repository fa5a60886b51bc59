"""Hosts as processes of their own: large messages, a reader that is frozen, and how they end."""

from __future__ import annotations

import itertools
import os
import signal
import socket
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

import pytest

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.deployment import MAX_CLIENTS
from colony.runtime.protocol.messages import (
    Effect,
    Message,
    Sample,
    SendMessage,
    ServerFrame,
    Tick,
    WakeAt,
)
from colony.runtime.transport.live.configuration import BLOCK_TIMEOUT_US
from colony.runtime.transport.live.network import ZenohSession
from tests.runtime.transport.live.outside import SERVER, Outside
from tests.runtime.transport.live.stage import Recorder, hosted, python_process, robot_address
from tests.waiting import until

LARGE = """
import os, signal, sys
from colony.runtime.protocol import topics
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import local
from colony.runtime.protocol.messages import Checkpoint, SendMessage
from tests.runtime.transport.live.stage import Recorder

def save(message, now_ns):
    saved = Checkpoint(client="c", k=message.k, start=0, memory=bytes(1_000_000))
    yield SendMessage(topics.checkpoints("DServer"), saved)

recorder = Recorder("drive/c", topics.TICKS, on=save)
with Host.open(local("rome", os.environ), [recorder]) as host:
    signal.signal(signal.SIGTERM, lambda *_: host.stop())
    host.run()
"""


def test_a_large_checkpoint_gets_through(
    environment: Mapping[str, str],
) -> None:
    server = Recorder("DServer", topics.checkpoints("DServer"))
    with (
        python_process(environment, "-c", LARGE) as process,
        hosted(environment, [server]) as host,
        ZenohSession.open(robot_address(environment), server_names=("Clock",)) as clock,
    ):
        until(lambda: "drive/c" in clock.alive(), "it is there for the Clock")
        until(lambda: "drive/c" in host.network.alive(), "it is there for DServer")
        went: list[str] = []
        host.network.watch(lambda address, present: went.append(address))
        for k in range(5):
            Outside(clock).put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
        until(lambda: len(server.got) == 5, "all came")
        assert went == [], "its link was given up"
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0


CROWD = """
import os, signal, sys
from colony.runtime.protocol import topics
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import local
from colony.runtime.protocol.messages import Checkpoint, Request, SendMessage
from tests.runtime.transport.live.stage import Recorder

def requests(message, now_ns):
    saved = Checkpoint(client="drive/crowd", k=message.k, start=0, memory=bytes(100_000))
    yield SendMessage(topics.checkpoints("RServer"), saved)
    for n in range(int(sys.argv[1])):
        client = f"client_of_a_long_name_{n}"
        request = Request(k=message.k, actuator="drive", client=client, bid="command", values=(100.0, 1.5))
        yield SendMessage(topics.requests("RServer"), request)
    silent = Request(k=message.k, actuator="out", client="alone", bid="silent")
    yield SendMessage(topics.requests("DServer"), silent)

crowd = Recorder("drive/crowd", topics.TICKS, on=requests)
with Host.open(local("rome", os.environ), [crowd]) as host:
    signal.signal(signal.SIGTERM, lambda *_: host.stop())
    host.run()
"""
"""A process of many clients of RServer, which keeps a large checkpoint for them, and one of DServer."""


def test_the_requests_of_a_whole_program_get_through(
    environment: Mapping[str, str],
) -> None:
    ticks = 3
    server = Recorder("RServer", topics.requests("RServer"))
    with (
        python_process(environment, "-c", CROWD, str(MAX_CLIENTS)),
        hosted(environment, [server]) as host,
        ZenohSession.open(robot_address(environment), server_names=("Clock",)) as clock,
    ):
        until(lambda: "drive/crowd" in clock.alive(), "it is there for the Clock")
        until(lambda: "drive/crowd" in host.network.alive(), "it is there for RServer")
        for k in range(ticks):
            Outside(clock).put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
            until(lambda n=(k + 1) * MAX_CLIENTS: len(server.got) == n, "all came")  # type: ignore[misc]


FROZEN_SERVER = """
import os
from colony.runtime.protocol import topics
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import local
from tests.runtime.transport.live.stage import Recorder

server = Recorder("RServer", topics.requests("RServer"), topics.checkpoints("RServer"))
with Host.open(local("rome", os.environ), [server], serves=True) as host:
    print("ready", flush=True)
    host.run()
"""


def test_a_server_that_is_frozen_makes_no_client_of_another_server_late(
    environment: Mapping[str, str],
) -> None:
    """Ticks follow each other as soon as the one client of DServer has spoken, until more bytes are sent to
    RServer than any link and socket have room for."""
    ticks = 100
    server = Recorder("DServer", topics.requests("DServer"))
    with (
        python_process(environment, "-c", FROZEN_SERVER, says="ready") as frozen,
        python_process(environment, "-c", CROWD, str(MAX_CLIENTS)),
        hosted(environment, [server]) as host,
        ZenohSession.open(robot_address(environment), server_names=("Clock",)) as clock,
    ):
        until(lambda: "drive/crowd" in clock.alive(), "it is there for the Clock")
        until(lambda: "drive/crowd" in host.network.alive(), "it is there for DServer")
        frozen.send_signal(signal.SIGSTOP)
        for k in range(ticks):
            Outside(clock).put(topics.TICKS, codec.encode(Tick(k=k, t_ns=0)))
            until(lambda n=k + 1: len(server.got) == n, "its request came")  # type: ignore[misc]
    gaps = [b - a for a, b in itertools.pairwise(server.times)]
    assert max(gaps) < BLOCK_TIMEOUT_US * 1000 // 2, (
        "who waits for room is held up until the link is given up"
    )


FROZEN = """
import os, signal, sys
from colony.runtime.protocol import topics
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import local
from tests.runtime.transport.live.stage import Recorder

with Host.open(local("rome", os.environ), [Recorder("drive/frozen", topics.frames("PServer"))]) as host:
    print("ready", flush=True)
    host.run()
"""


def test_a_reader_that_is_frozen_does_not_hold_up_a_server(environment: Mapping[str, str]) -> None:
    frames, fields = 200, {"big": Sample(tuple(float(n) for n in range(10_000)), 0)}

    def publish_frames(message: Message, now_ns: int) -> Iterable[Effect]:
        if len(server.got) <= frames:
            topic = topics.frames("PServer")
            yield SendMessage(topic, ServerFrame(server="PServer", k=len(server.got), fields=fields))
            yield WakeAt(now_ns + 1_000_000)

    server = Recorder("PServer", topics.TICKS, on=publish_frames)
    with (
        python_process(environment, "-c", FROZEN, says="ready") as process,
        hosted(environment, [server]) as host,
    ):
        until(lambda: "drive/frozen" in host.network.alive(), "the reader is there")
        process.send_signal(signal.SIGSTOP)
        with ZenohSession.open(robot_address(environment)) as network:
            Outside(network).put(topics.TICKS, codec.encode(Tick(k=0, t_ns=0)))
        until(lambda: len(server.got) > frames, "all frames are published")
    gaps = [b - a for a, b in zip(server.times, server.times[1:], strict=False)]
    assert max(gaps) < BLOCK_TIMEOUT_US * 1000 // 2, (
        "who waits for room is held up until the link is given up"
    )


PROCESS = """
import os, signal, sys
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import local
from tests.runtime.transport.live.stage import Recorder

class Node(Recorder):
    def close(self):
        print("closed", flush=True)

with Host.open(local("rome", os.environ), [Node("RServer")], serves=True) as host:
    signal.signal(signal.SIGTERM, lambda *_: host.stop())
    print("ready", flush=True)
    host.run()
print("ended", flush=True)
"""


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_a_process_ends_by_a_signal_and_another_takes_its_place(
    environment: Mapping[str, str], how: signal.Signals
) -> None:
    for _ in range(2):
        with (
            python_process(environment, "-c", PROCESS, says="ready") as process,
            ZenohSession.open(robot_address(environment)) as network,
        ):
            until(lambda n=network: n.alive() == (SERVER,), "it is there")  # type: ignore[misc]
            process.send_signal(how)
            rest = process.communicate(timeout=20)[0]
            until(lambda n=network: n.alive() == (), "it is gone")  # type: ignore[misc]
        assert rest == ("closed\nended\n" if how is signal.SIGTERM else "")
        assert process.returncode == (0 if how is signal.SIGTERM else -9)


ZENOH_CLOSE_S = 10.0
"""Seconds after which zenoh gives up to close a session."""


def test_a_session_closes_although_a_server_that_it_dials_is_frozen(environment: Mapping[str, str]) -> None:
    with python_process(environment, "-c", PROCESS, says="ready") as process:
        process.send_signal(signal.SIGSTOP)
        network = ZenohSession.open(robot_address(environment))
        until(lambda: _dials(robot_address(environment).directory.path), "it dials the server")
        begin = time.monotonic()
        network.close()
        assert time.monotonic() - begin < ZENOH_CLOSE_S
        assert not _dials(robot_address(environment).directory.path)


def test_a_session_that_closes_beside_a_frozen_server_leaves_a_server_of_its_process_in_reach(
    environment: Mapping[str, str],
) -> None:
    directory = robot_address(environment).directory
    with (
        python_process(environment, "-c", PROCESS, says="ready") as process,
        ZenohSession.open(robot_address(environment), server_names=("PServer",)),
        socket.socket(socket.AF_UNIX) as caller,
    ):
        process.send_signal(signal.SIGSTOP)
        closing = ZenohSession.open(robot_address(environment))
        until(lambda: _dials(directory.path), "it dials the server")
        closing.close()
        caller.connect(str(directory.socket("PServer")))
        process.send_signal(signal.SIGCONT)


def _dials(folder: Path) -> bool:
    """Return True if this process has a socket that is connected to one in the folder."""
    for descriptor in os.listdir("/proc/self/fd"):
        with suppress(OSError), socket.socket(fileno=os.dup(int(descriptor))) as link:
            if link.family == socket.AF_UNIX and str(link.getpeername()).startswith(str(folder)):
                return True
    return False
