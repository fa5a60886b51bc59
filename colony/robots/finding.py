"""Robots that run already: what there is of them on this machine, and sessions with them."""

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
        LiveError, ServerNotFound: it cannot be reached, or is not there.
    """
    from colony.runtime.kit.connection import Session
    from colony.runtime.transport.live.place import Remote

    if isinstance(place, Remote):
        return Session.open(place.robot, gateway=place.endpoint, credentials=place.credentials)
    return Session.open(place.robot)


def running_robots(environment: Mapping[str, str] = os.environ) -> dict[str, Mapping[str, int]]:
    """Return the robots of this machine of which something runs: the names of that, with process ids."""
    from colony.runtime.transport.live.run_directory import RunDirectory

    directory = RunDirectory.find(environment)
    found = {name: directory.robot(name).running() for name in directory.robots()}
    return {name: running for name, running in found.items() if running}
