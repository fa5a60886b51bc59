"""A flood, as a process of its own: `python -m tools.attack.flood ORDER`, ORDER in JSON.

It is limited in number, rate and time, and prints in the end how many messages it sent.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Literal, get_args

import msgspec
import zenoh

from colony.runtime.assembly.processes.spec import (
    LocalAddressSpec,
    RemoteAddressSpec,
    address_of,
    address_spec,
)
from colony.runtime.library.robot import Drive
from colony.runtime.protocol import codec
from colony.runtime.protocol.calls import NoArguments, Open
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.messages import Call, Fetch, Right
from colony.runtime.transport.live import configuration
from colony.runtime.transport.live.network import local_user
from colony.runtime.transport.live.robot_address import Remote, RobotAddress, local
from tests.cli.machine import ROBOT
from tools.attack.lab import Lab

Kind = Literal[
    "command calls", "read calls", "fetches", "malformed", "large", "declarations", "strangers", "local calls"
]
KINDS: tuple[Kind, ...] = get_args(Kind)

PRIORITY = 1_000
"""Priority of the calls of a flood, above those of honest users."""

WHO: dict[Kind, str] = {
    "command calls": "driver",
    "read calls": "reader",
    "fetches": "reader",
    "malformed": "driver",
    "large": "driver",
    "declarations": "reader",
    "strangers": "stranger",
    "local calls": "",
}
"""The user whose certificate a flood of a kind comes with; none for a program on the robot's own machine."""

LOCAL_RATE = 10_000.0
"""Messages a second of a flood on the robot's own machine, which leaves the robot a processor to live on."""


class Order(msgspec.Struct, frozen=True, kw_only=True):
    """What to send, where, and as which user.

    Messages come from `sessions` sessions in turn, `rate` of them a second, or as many as there go if it is
    0; with `batched`, zenoh collects them. `niceness` is that of the process.
    """

    kind: Kind
    robot_address: LocalAddressSpec | RemoteAddressSpec
    user: str
    seconds: float
    most: int = 1_000_000
    rate: float = 0.0
    sessions: int = 1
    batched: bool = False
    niceness: int = 0


class Flood:
    """A flood that runs. Mutable: until it has ended."""

    def __init__(self, order: Order) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tools.attack.flood", msgspec.json.encode(order).decode()],
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        self._line()  # it has its session

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def flows(self) -> bool:
        """Return whether it is still sending."""
        return self._process.poll() is None

    def end(self) -> int:
        """End it, if it has not ended, and return how many messages it sent."""
        if self.flows():
            self._process.send_signal(signal.SIGTERM)
        sent = self._line()
        self._process.wait(20)
        return int(sent or 0)

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


@contextmanager
def flood(
    lab: Lab,
    kind: Kind,
    *,
    seconds: float,
    rate: float = 0.0,
    most: int = 1_000_000,
    sessions: int = 1,
    batched: bool = False,
    niceness: int = 0,
) -> Iterator[Flood]:
    """A flood until the end of the block, or until its bounds."""
    robot_address: RobotAddress
    if WHO[kind]:
        who = lab.authority.user(WHO[kind])
        robot_address, user = Remote(robot=ROBOT, endpoint=lab.endpoint, credentials=who), who.user
    else:
        robot_address, user = local(ROBOT, lab.machine.environment), local_user()
        rate = rate or LOCAL_RATE
    order = Order(
        kind=kind,
        robot_address=address_spec(robot_address),
        user=user,
        seconds=seconds,
        rate=rate,
        most=most,
        sessions=sessions,
        batched=batched,
        niceness=niceness,
    )
    with poured(order) as running:
        yield running


@contextmanager
def poured(order: Order) -> Iterator[Flood]:
    """Pour until the end of the block, or until the bounds of the order."""
    running = Flood(order)
    try:
        yield running
    finally:
        running.kill()


def messages(order: Order) -> Iterator[tuple[str, bytes]]:
    """Yield the keys and bytes of a flood, which opens its connection first, as honest users do."""
    robot = address_of(order.robot_address).robot
    server, connection = f"colony/{robot}/RServer", f"{order.user}/1"

    def call(right: Right, number: int, method: str, arguments: object) -> tuple[str, bytes]:
        raw = msgspec.Raw(msgspec.msgpack.encode(arguments))
        made = Call(
            connection=connection, number=number, method=method, arguments=raw, right=right, priority=PRIORITY
        )
        return f"{server}/call/{right}/{connection}", codec.encode(made)

    match order.kind:
        case "command calls":
            yield call("command", 1, "open", Open(name="flood"))
            yield from (call("command", n, "drive", Drive(velocity=0.0, turn=0.0)) for n in count(2))
        case "read calls":
            yield call("read", 1, "open", Open(name="flood"))
            yield from (call("read", n, "position", NoArguments()) for n in count(2))
        case "fetches":
            yield from (
                (f"{server}/fetches/{order.user}", codec.encode(Fetch(server="RServer", k=k)))
                for k in count(1)
            )
        case "malformed":
            yield from ((f"{server}/call/command/{connection}", os.urandom(64)) for _ in count())
        case "large":
            yield from ((f"{server}/call/command/{connection}", bytes(MAX_MESSAGE_BYTES)) for _ in count())
        case "local calls":
            yield call("command", 1, "open", Open(name="flood"))
            yield from (call("command", n, "drive", Drive(velocity=0.0, turn=0.0)) for n in count(2))
        case "declarations" | "strangers":
            raise AssertionError("no messages")


def pour(order: Order, ended: Callable[[], bool]) -> int:
    """Send until a limit of the order, or until `ended`; return how many messages were sent."""
    sent, begin = 0, time.monotonic()
    due = begin + order.seconds

    def on_time() -> bool:
        if order.rate and (wait := begin + sent / order.rate - time.monotonic()) > 0:
            time.sleep(wait)
        return sent < order.most and not ended() and time.monotonic() < due

    settings = configuration.configuration(configuration.settings(address_of(order.robot_address)))
    if order.kind == "strangers":
        print("flows", flush=True)
        while on_time():
            with suppress(zenoh.ZError):
                zenoh.open(settings).close()  # type: ignore[no-untyped-call]
            sent += 1
        return sent
    with ExitStack() as resources:
        opened = [resources.enter_context(zenoh.open(settings)) for _ in range(order.sessions)]
        session = opened[0]
        print("flows", flush=True)
        if order.kind == "declarations":
            while on_time():
                key = f"colony/{ROBOT}/RServer/reply/{order.user}/{sent}"
                declared = session.declare_subscriber(key, zenoh.handlers.Callback(_ignore, indirect=False))
                declared.undeclare()  # type: ignore[no-untyped-call]
                sent += 1
            return sent
        for key, data in messages(order):
            if not on_time():
                break
            opened[sent % len(opened)].put(
                key,
                data,
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.REAL_TIME,
                express=not order.batched,
            )
            sent += 1
    return sent


def _ignore(sample: zenoh.Sample) -> None:
    """It is not for us."""


def main(text: str) -> None:
    ended = False

    def end(*_: object) -> None:
        nonlocal ended
        ended = True

    signal.signal(signal.SIGTERM, end)
    order = msgspec.json.decode(text, type=Order)
    os.nice(order.niceness)
    print(pour(order, lambda: ended), flush=True)
    os._exit(0)  # what still waits to be sent is of no use


if __name__ == "__main__":
    main(sys.argv[1])
