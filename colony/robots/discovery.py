"""Running robots: their discovery on this machine, and sessions with them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from colony.runtime.kit.connection import Session
    from colony.runtime.transport.live.place import Place


def session_with(place: Place) -> Session:
    """Open a session with a robot.

    Raises:
        LiveError, ServerNotFoundError: the robot cannot be reached, or does not exist.
    """
    from colony.runtime.kit.connection import Session
    from colony.runtime.transport.live.place import Remote

    if isinstance(place, Remote):
        return Session.open(place.robot, gateway=place.endpoint, credentials=place.credentials)
    return Session.open(place.robot)


def running_robots(environment: Mapping[str, str] = os.environ) -> dict[str, Mapping[str, int]]:
    """Return the running robots of this machine: their processes by name, with process ids."""
    from colony.runtime.transport.live.run_directory import RunDirectory

    directory = RunDirectory.find(environment)
    found = {name: directory.robot(name).running() for name in directory.robots()}
    return {name: running for name, running in found.items() if running}
