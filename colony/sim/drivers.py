"""Drivers of simulated devices, for the servers of a robot.

Several robots may share a world and a clock. The world catches up with the clock whenever a device is read or
commanded, so that time is the same for all robots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from colony.runtime.protocol.images import Image, Shot
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseState, CameraDriver, Drivers
from colony.sim.compiled import Bytes2
from colony.sim.config import limits_of
from colony.sim.world.world import MAX_STEP_S, World


class Plant:
    """A world that is kept in step with a clock in nanoseconds. Stateful: remembers the simulated time.

    `step_callbacks` are called after each step, with its length in seconds. They move everything that is
    neither a robot nor a person; an example is `colony.sim.world.elevators.Elevators.advance`.
    """

    def __init__(
        self, world: World, clock: Callable[[], int], step_callbacks: Sequence[Callable[[float], None]] = ()
    ) -> None:
        self.world = world
        self._clock = clock
        self._step_callbacks = tuple(step_callbacks)
        self._simulated_ns = clock()

    def catch_up(self) -> int:
        """Advance the world to the clock's time, and return that time."""
        now = self._clock()
        while self._simulated_ns < now:
            step = min(now - self._simulated_ns, int(MAX_STEP_S * 1e9))
            self.world.advance(step / 1e9)
            for callback in self._step_callbacks:
                callback(step / 1e9)
            self._simulated_ns += step
        return now


def base_state(world: World, robot: int, t_ns: int) -> BaseState:
    """Return the reported state of a robot's base: odometry and bumpers, not the true pose."""
    pose, speed, bumper = world.odometry(robot), world.speed(robot), world.bumper(robot)
    return BaseState(
        t_ns=t_ns,
        x=pose.x_mm,
        y=pose.y_mm,
        heading=pose.heading_deg,
        front_bumper=bumper.front,
        rear_bumper=bumper.rear,
        speed=speed.velocity_mm_s,
        turn_rate=speed.turn_deg_s,
        wheel_speed=world.wheel_speed(robot),
    )


class SimulatedBase:
    """The base of robot number `robot`. Stateful: caches its latest state."""

    register_bits: int | None = None

    def __init__(self, plant: Plant, robot: int) -> None:
        self._plant = plant
        self._robot = robot
        self._state: BaseState | None = None
        self.limits = limits_of(plant.world.config)

    def drive(self, velocity: float, turn: float) -> None:
        """Command the speeds of the base, after the world has caught up with the clock."""
        self._plant.catch_up()
        self._plant.world.command(self._robot, velocity, turn)

    def stop(self) -> None:
        """Command the base to stop."""
        self.drive(0.0, 0.0)

    def state(self) -> BaseState:
        """Return the base's state now."""
        now = self._plant.catch_up()
        if self._state is None or self._state.t_ns != now:
            self._state = base_state(self._plant.world, self._robot, now)
        return self._state


class SimulatedProximity:
    """The sonars and infrared detectors of robot number `robot`; each ring is measured when it is read."""

    def __init__(self, plant: Plant, robot: int) -> None:
        self._plant = plant
        self._robot = robot

    def sonar(self) -> Sample:
        """Return the sonar readings now."""
        now = self._plant.catch_up()
        return Sample(tuple(self._plant.world.sonar(self._robot).tolist()), now)

    def infrared(self) -> Sample:
        """Return the infrared readings now."""
        now = self._plant.catch_up()
        return Sample(tuple(self._plant.world.infrared(self._robot).tolist()), now)


class SimulatedCamera:
    """A camera of a robot; each image is taken when it is grabbed.

    Args:
        plant: the world and its clock.
        take: callback that takes an image; its argument is the current time in ns. The image may be drawn
            later, when it is read.
    """

    def __init__(self, plant: Plant, take: Callable[[int], Shot]) -> None:
        self._plant = plant
        self._take = take

    def grab(self) -> Shot:
        """Return a shot of the camera now."""
        return self._take(self._plant.catch_up())


def image_of(pixels: Bytes2, t_ns: int, first_row: int = 0) -> Image:
    """Return an image, or a band of one that begins at `first_row`, with these gray pixels."""
    height, width = pixels.shape
    return Image(
        t_ns=t_ns, height=height, width=width, channels=1, pixels=pixels.tobytes(), first_row=first_row
    )


def simulated_drivers(
    plant: Plant, robot: int = 0, *, cameras: Mapping[str, CameraDriver] | None = None
) -> Drivers:
    """Return all devices of one simulated robot; `cameras` are keyed by the names of their servers."""
    base, proximity = SimulatedBase(plant, robot), SimulatedProximity(plant, robot)
    return Drivers(base=base, proximity=proximity, cameras=cameras or {})
