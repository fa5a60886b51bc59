"""Two machines, as two network namespaces joined by a cable that can be pulled."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from colony.runtime.frames.clock import Clock
from colony.runtime.servers.drivers import BaseLimits, BaseState
from colony.runtime.servers.rserver import RServer
from colony.runtime.transport.live.gateway import open_gateway
from colony.runtime.transport.live.network import local_time
from colony.runtime.transport.live.security import read_security
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.runtime.transport.live.stage import ROBOT, hosted, robot_address, run_directory, running
from tests.waiting import until

HERE, THERE = "198.18.231.1", "198.18.231.2"
SECOND = 1_000_000_000
TRIES = 3

CLIENT = """
import sys, time
from pathlib import Path
from colony.runtime.kit.connection import connect
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import robot
from colony.runtime.transport.live.security import read_credentials

endpoint, login = sys.argv[1], Path(sys.argv[2])
arguments = dict(robot="rome", gateway=endpoint, credentials=read_credentials(login), timeout_s=1.0)
with connect("RServer", name="teleop", priority=5, **arguments) as base:
    while True:
        try:
            base.do(ASK)
            print("done", flush=True)
        except RobotConnectionError as problem:
            print(type(problem).__name__, flush=True)
        time.sleep(0.1)
"""
"""Asks RServer for the same again and again, ten times a second."""


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


def _can_make_networks() -> bool:
    if os.geteuid() != 0 or shutil.which("ip") is None:
        return False
    name = f"colony-try-{os.getpid()}"
    tried = subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False)
    if tried.returncode == 0:
        _run("ip", "netns", "delete", name)
    return tried.returncode == 0


_cables = itertools.cycle("abcdefgh")


@contextmanager
def _cable() -> Iterator[tuple[str, str]]:
    """A namespace, and the end of the cable to it that is here."""
    own = f"{os.getpid()}{next(_cables)}"  # the kernel takes its time to forget a cable
    name, here, there = f"colony-{own}", f"cola{own}", f"colb{own}"
    with ExitStack() as undo:
        _run("ip", "netns", "add", name)
        undo.callback(_run, "ip", "netns", "delete", name)  # takes both ends of the cable with it
        _run("ip", "link", "add", here, "type", "veth", "peer", "name", there, "netns", name)
        _run("ip", "address", "add", f"{HERE}/30", "dev", here)
        _run("ip", "link", "set", here, "up")
        inside = ("ip", "-n", name)
        _run(*inside, "address", "add", f"{THERE}/30", "dev", there)
        _run(*inside, "link", "set", there, "up")
        _run(*inside, "link", "set", "lo", "up")
        yield name, here


class _Base:
    """A base that notes what it is told. Mutable: that."""

    limits = BaseLimits(velocity=600.0, turn=90.0, acceleration=800.0, turn_acceleration=240.0)
    register_bits = None

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock
        self.velocity = 0.0
        self.changed_ns = 0

    def drive(self, velocity: float, turn: float) -> None:
        if velocity != self.velocity:
            self.velocity, self.changed_ns = velocity, self._clock()

    def stop(self) -> None:
        self.drive(0.0, 0.0)

    def state(self) -> BaseState:
        return BaseState(
            t_ns=self._clock(),
            x=0.0,
            y=0.0,
            heading=0.0,
            front_bumper=False,
            rear_bumper=False,
            speed=self.velocity,
            turn_rate=0.0,
            wheel_speed=abs(self.velocity),
        )


class _Remote:
    """The client on the other machine. Mutable: what of its output was read."""

    def __init__(self, namespace: str, code: str, endpoint: str, login: Path) -> None:
        self._process = subprocess.Popen(
            ["ip", "netns", "exec", namespace, sys.executable, "-c", code, endpoint, str(login)],
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])},
            stdout=subprocess.PIPE,
            text=True,
        )

    def says(self, word: str) -> None:
        """Read on until it says this."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.strip() == word:
                return
        raise AssertionError(f"it ended before it said {word}")

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()


@dataclass(frozen=True, slots=True)
class _Split:
    """A robot here, a client on the other machine, and the cable between them."""

    environment: Mapping[str, str]
    base: _Base
    server: RServer
    remote: _Remote
    cable: str

    def set(self, state: str) -> int:
        """Pull the cable (`down`) or plug it in (`up`); the robot's time just before."""
        now_ns = local_time(robot_address(self.environment))()
        _run("ip", "link", "set", self.cable, state)
        return now_ns


@contextmanager
def _split(folder: Path, ask: str) -> Iterator[_Split]:
    """A robot whose client asks for this from the other machine."""
    authority = Authority(folder)
    security = read_security(authority.table({"ada": ("read", "command")}, HERE))
    authority.user("ada")
    login = folder / "login.toml"
    login.write_text('user="ada"\ncertificate="ada.pem"\nkey="ada.key"\nauthority="authority.pem"\n')
    with ExitStack() as holds:
        environment = holds.enter_context(run_directory())
        namespace, cable = holds.enter_context(_cable())
        base = _Base(local_time(robot_address(environment)))
        server = RServer(base)
        holds.enter_context(hosted(environment, [Clock(servers=("RServer",), frames_kept=100)]))
        holds.enter_context(hosted(environment, [server]))
        endpoint = f"tls/{HERE}:{free_port()}"
        holds.enter_context(running(open_gateway(robot_address(environment), endpoint, security)))
        remote = _Remote(namespace, CLIENT.replace("ASK", ask), endpoint, login)
        holds.callback(remote.end)
        yield _Split(environment, base, server, remote, cable)


pytestmark = pytest.mark.skipif(not _can_make_networks(), reason="needs root, and to make network namespaces")


def test_a_robot_stops_when_the_cable_is_pulled_and_goes_on_when_it_is_back(tmp_path: Path) -> None:
    assert ROBOT == "rome"
    with _split(tmp_path, "robot.drive(100.0, 0.0)") as split:
        base = split.base
        for _ in range(2):
            split.remote.says("done")
            until(lambda: base.velocity == 100.0, "the robot drives")
            pulled_ns = split.set("down")
            until(lambda: base.velocity == 0.0, "the robot stops")
            assert base.changed_ns - pulled_ns < 2 * SECOND
            until(lambda: not split.server._calls._connections, "the client is lost")
            split.remote.says("CallTimeoutError")
            split.set("up")
            until(lambda: base.velocity == 100.0, "the robot drives again")


def test_a_lock_is_free_within_a_second_of_the_pulled_cable(tmp_path: Path) -> None:
    with _split(tmp_path, "robot.lock()") as split:
        lock, took = split.server._actuators._outside.lock, list[int]()
        while not took or (min(took) > SECOND and len(took) < TRIES):
            until(lambda: lock.holder is not None, "the client has the lock, or has it again")
            split.set("down")
            pulled = time.monotonic_ns()
            until(lambda: lock.holder is None, "the lock is free")
            took.append(time.monotonic_ns() - pulled)
            split.set("up")
        print(f"free after {', '.join(f'{ns / 1e6:.0f}' for ns in took)} ms")
        assert min(took) <= SECOND
        until(lambda: lock.holder is not None, "the client is back")
