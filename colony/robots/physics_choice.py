"""Which robots a physics can simulate: what says so loads neither."""

from __future__ import annotations

from colony.body.model import Body
from colony.robots.request import MisuseError, PhysicsName


def expect_simulable(physics: PhysicsName, body: Body, file: str) -> None:
    """Raise MisuseError if a physics does not simulate what a robot has.

    Args:
        physics: the physics of the run.
        body: the body of its robot.
        file: the file of the behavior, which the message names.

    Raises:
        MisuseError: the robot cannot be simulated.
    """
    if physics != "mujoco":
        return
    from colony.sim.mujoco.model import build_of

    try:
        build_of(body)
    except ValueError as problem:
        text = f"`{body.robot.name}` cannot be simulated: {problem}"
        raise MisuseError(f"{file}: error: {text}") from None
