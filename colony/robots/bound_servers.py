"""What a program needs of a robot that runs: that it runs, and servers that its description does not have."""

from __future__ import annotations

from contextlib import suppress

from colony.ir.program import Robot
from colony.ir.servers import ServerSpec
from colony.robots.described import DescribedRobot
from colony.robots.discovery import running_robots, session_with
from colony.robots.request import MisuseError
from colony.runtime.protocol.bindings import bound_servers
from colony.runtime.transport.live.robot_address import Local, RobotAddress


def expect_running(robot_address: RobotAddress, described: DescribedRobot) -> None:
    """Check that a robot on this machine has processes; one behind a gateway is not checked.

    Raises:
        MisuseError: it has none.
    """
    if isinstance(robot_address, Local) and not robot_address.directory.running():
        robots = ", ".join(running_robots()) or "none"
        robot, kind = robot_address.robot, described.path and described.path.stem
        served = robot if kind in (None, robot) else f"{robot}={kind}"
        raise MisuseError(
            f"colony: error: no process of `{robot}` runs on this machine "
            f"(running robots: {robots}); "
            f"start it with `colony serve all --robot {served} --map MAP`, "
            "a real one with --hardware or --port PORT in place of the map"
        )


def additional_servers(
    robot: Robot, described: DescribedRobot, robot_address: RobotAddress
) -> tuple[ServerSpec, ...]:
    """Return the servers of sensors and actuators that the description lacks, as they describe themselves.

    Servers that do not run, or have no valid description, are left out.
    """
    known_servers = {server.name for server in described.servers}
    additional_names = [name for name in bound_servers(robot) if name not in known_servers]
    if not additional_names:
        return ()
    from colony.runtime.kit.description import describe, server_spec
    from colony.runtime.kit.errors import RobotConnectionError

    specs = []
    with suppress(RobotConnectionError), session_with(robot_address) as session:
        for name in additional_names:
            with suppress(RobotConnectionError, ValueError), session.connect(name) as connection:
                specs.append(server_spec(connection.do(describe())))
    return tuple(specs)
