"""The links between a robot's processes: every pair has one, and only one of its ends ever dials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import pytest

from colony.runtime.transport.live import configuration
from colony.runtime.transport.live.configuration import DIALED_SERVERS, GATEWAY, Settings
from colony.runtime.transport.live.security import Security
from tests.runtime.transport.live.stage import robot_address, run_directory

OWN_NAMES = ("Zoom", "Arm", "Lift")
"""Servers of users, in the order of their start, which is neither that of their names nor its reverse."""

CONNECTING = ("watch", "stops of Zoom")
"""Processes that only connect, and the second session of a server. They need no links to each other."""


class Robot(NamedTuple):
    """The settings of its processes by name."""

    directory: Path
    processes: Mapping[str, Settings]

    def dials(self, one: str, other: str) -> bool:
        """Return True if the first process dials the second one's socket, or a slot that leads to it."""
        return bool(self._paths(one, "connect") & self._paths(other, "listen"))

    def _paths(self, name: str, end: str) -> set[Path]:
        endpoints = self.processes[name][f"{end}/endpoints"]
        assert isinstance(endpoints, list)
        local = [e for e in endpoints if e.startswith("unixsock-stream/")]
        return {Path(e.removeprefix("unixsock-stream/").partition("#")[0]).resolve() for e in local}


@pytest.fixture
def robot() -> Iterator[Robot]:
    """The processes that only connect begin first; a server of a user is restarted."""
    with run_directory() as environment, ExitStack() as claims:
        address = robot_address(environment)
        directory = address.directory
        directory.prepare()
        made = {
            "watch": configuration.settings(address),
            CONNECTING[1]: configuration.stop_settings(directory),
        }
        security = Security(certificate=Path("c"), key=Path("k"), authority=Path("a"), users={})
        made[GATEWAY] = configuration.gateway_settings(directory, "tls/localhost:7447", security)
        for name in (*DIALED_SERVERS[1:], *OWN_NAMES, "Arm"):
            if name not in made:
                claims.enter_context(directory.claim(name))
            made[name] = configuration.settings(address, server=name)
        yield Robot(directory.path, made)


def test_every_pair_of_processes_has_one_end_that_dials(robot: Robot) -> None:
    """With two, zenoh may lose a link for good after a break (zenoh issue 2806)."""
    for one, other in combinations(robot.processes, 2):
        dialing = robot.dials(one, other) + robot.dials(other, one)
        if CONNECTING[1] in (one, other):  # it has a link to the gateway alone
            expected = int(GATEWAY in (one, other))
        else:
            expected = int(not {one, other} <= {*CONNECTING})
        assert dialing == expected, (one, other)
    assert not any(robot.dials(name, name) for name in robot.processes)


@pytest.mark.parametrize("name", [*DIALED_SERVERS[1:], *OWN_NAMES, *CONNECTING])
def test_no_other_link_comes_about_and_none_is_given_up(robot: Robot, name: str) -> None:
    settings = robot.processes[name]
    assert settings["scouting/gossip/enabled"] is settings["scouting/multicast/enabled"] is False
    assert settings["connect/timeout_ms"] == -1
    dialed = settings["connect/endpoints"]
    assert isinstance(dialed, list)
    assert all("#retry_period_max_ms=" in endpoint for endpoint in dialed)


def test_the_gateway_dials_nobody(robot: Robot) -> None:
    assert robot.processes[GATEWAY]["connect/endpoints"] == []
