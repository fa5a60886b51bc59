"""Running robots: their discovery on this machine, and sessions with them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from colony.runtime.kit.connection import Session
    from colony.runtime.transport.live.robot_address import RobotAddress


def session_with(robot_address: RobotAddress) -> Session:
    """Open a session with a robot.

    Raises:
        LiveError, ServerNotFoundError: the robot cannot be reached, or does not exist.
    """
    from colony.runtime.kit.connection import Session
    from colony.runtime.transport.live.robot_address import Remote

    if isinstance(robot_address, Remote):
        return Session.open(
            robot_address.robot, gateway=robot_address.endpoint, credentials=robot_address.credentials
        )
    return Session.open(robot_address.robot)


def running_robots(environment: Mapping[str, str] = os.environ) -> dict[str, Mapping[str, int]]:
    """Return the robots that run on this machine, each with its processes: process ids by name."""
    from colony.runtime.transport.live.run_directory import RunDirectory

    directory = RunDirectory.find(environment)
    processes = {name: directory.robot(name).running() for name in directory.robots()}
    return {name: running for name, running in processes.items() if running}
