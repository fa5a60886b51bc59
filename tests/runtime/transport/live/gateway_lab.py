"""A robot behind a gateway, its users, and what they send and hear."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh

from colony.runtime.kit.connection import Session
from colony.runtime.protocol import codec
from colony.runtime.transport.live.gateway import open_gateway
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import declare_publisher
from colony.runtime.transport.live.robot_address import Credentials, Remote
from colony.runtime.transport.live.security import Permission, read_security
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.runtime.transport.live.stage import ROBOT, robot_address, run_directory, running
from tests.waiting import until

USERS: dict[str, tuple[Permission, ...]] = {
    "ada": ("read", "command"),
    "bob": ("read",),
    "carl": ("stop",),
    "eva": ("run",),
}


class Lab:
    """A robot behind a gateway. Mutable: certificates that were made."""

    def __init__(self, environment: Mapping[str, str], authority: Authority, endpoint: str) -> None:
        self.environment = environment
        self.authority = authority
        self.endpoint = endpoint

    def session(self, who: str | Credentials) -> Session:
        credentials = self.authority.user(who) if isinstance(who, str) else who
        return Session.open(ROBOT, gateway=self.endpoint, credentials=credentials)

    def remote(self, who: str) -> Remote:
        return Remote(robot=ROBOT, endpoint=self.endpoint, credentials=self.authority.user(who))


@contextmanager
def gateway_for(lab: Lab, users: Mapping[str, tuple[Permission, ...]]) -> Iterator[None]:
    security = read_security(lab.authority.table(users))
    with running(open_gateway(robot_address(lab.environment), lab.endpoint, security)):
        yield


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    with ExitStack() as holds:
        environment = holds.enter_context(run_directory())
        made = Lab(environment, Authority(tmp_path), f"tls/localhost:{free_port()}")
        holds.enter_context(gateway_for(made, USERS))
        yield made


def put(network: ZenohSession, key: str, data: bytes) -> None:
    with declare_publisher(network.session, key) as publisher:
        until(lambda: publisher.matching_status.matching, f"nobody listens to {key}")  # type: ignore[attr-defined]
        publisher.put(data)


def listen(network: ZenohSession, key: str, heard: list[object]) -> None:
    note(network, key, lambda sample: heard.append(codec.decode(sample.payload.to_bytes())))


def note(network: ZenohSession, key: str, take: Callable[[zenoh.Sample], None]) -> None:
    network.session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))
