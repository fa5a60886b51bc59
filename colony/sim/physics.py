"""What drivers and devices need of the physics that moves robots.

`colony.sim.world.world.World` is plane and kinematic: bases follow their commands exactly, and walls stop
them. Another physics sits behind the same drivers and devices, so that what they measure can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Protocol, TypeVar

from numpy import bool_, float64
from numpy.typing import NDArray

from colony.body.devices import Device
from colony.ir.servers import ServerSpec
from colony.nav.maps.stickrep.model import Pose
from colony.sim.config import RobotConfig
from colony.sim.mechanism import Mechanism
from colony.sim.world.world import PressedBumpers, Situation, Speed

T = TypeVar("T")


class Physics(Protocol):
    """Robots among walls, numbered from 0; commands and time go in, readings and poses come out.

    Lengths are in mm, angles in degrees, headings counterclockwise from north; x is east and y north.
    There is no clock: `advance` advances time.

    Attributes:
        configs: the parameters of each robot.
        seed: seed of the robots' own errors.
    """

    configs: tuple[RobotConfig, ...]
    seed: int

    def command(
        self, robot: int, velocity_mm_s: float, turn_deg_s: float, sideways_mm_s: float = 0.0
    ) -> None:
        """Set the target speeds of a robot, clamped to its limits, after the delay of its commands.

        Raises:
            ValueError: a speed is not finite.
        """
        ...

    def advance(self, dt_s: float) -> None:
        """Advance time by `dt_s` seconds, in one step, or in several if commands or readings are delayed.

        Raises:
            ValueError: the time is not above 0, or beyond `MAX_STEP_S`.
        """
        ...

    def carry_out(self, robot: int, command: Callable[[], None]) -> None:
        """Call `command` after the delay of a robot's commands, at once without one."""
        ...

    def on_step(self, callback: Callable[[], None]) -> None:
        """Call `callback` at the end of each step from now on."""
        ...

    @property
    def elapsed_ns(self) -> int:
        """The nanoseconds that were simulated so far."""
        ...

    def true_pose(self, robot: int) -> Pose:
        """Return the true pose of a robot."""
        ...

    def distance(self, robot: int) -> float:
        """Return the distance that a robot has driven so far, forward and backward, in mm."""
        ...

    def bumps(self, robot: int) -> int:
        """Return the number of a robot's collisions so far; a contact that lasts counts once."""
        ...

    def bumper(self, robot: int) -> PressedBumpers:
        """Return the bumpers of a robot."""
        ...

    def contact_bearings(self, robot: int) -> tuple[float, ...]:
        """Return the bearings at which a robot is touched, in degrees counterclockwise from ahead."""
        ...

    def placements(self, robot: int) -> int:
        """Return how often a robot was moved by hand instead of by its wheels."""
        ...

    def compass(self, robot: int) -> float:
        """Return the compass reading of a robot: its heading in degrees, in [0, 360), with disturbances."""
        ...

    def odometry(self, robot: int) -> Pose:
        """Return the pose of a robot according to its odometry, initially the true pose."""
        ...

    def travel(self, robot: int) -> tuple[float, ...]:
        """Return how far each wheel of a robot has rolled by its own report, in mm."""
        ...

    def speed(self, robot: int) -> Speed:
        """Return the current speed of a robot, as its wheels report it."""
        ...

    def wheel_speed(self, robot: int) -> float:
        """Return the mean magnitude of the speeds of both wheels, in mm/s."""
        ...

    def sonar(self, robot: int) -> NDArray[float64]:
        """Return the sonar readings, (channels,) float64 in mm, counterclockwise.

        Raises:
            ValueError: the robots have no ring of sonars.
        """
        ...

    def infrared(self, robot: int) -> NDArray[bool_]:
        """Return the infrared readings, (channels,) bool, numbered like the sonars.

        Raises:
            ValueError: the robots have no ring of sonars.
        """
        ...

    @property
    def holes(self) -> tuple[NDArray[float64], ...]:
        """The holes in the floor: polygons, (n, 2) in mm each. They stop nobody."""
        ...

    @property
    def docks(self) -> tuple[Pose, ...]:
        """The docks: the poses of robots that stand at them."""
        ...

    @property
    def person_radius_mm(self) -> float:
        """The radius of a person."""
        ...

    def situation(self) -> Situation:
        """Return what stands where now; it stays the same when the world goes on."""
        ...

    def shared(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what sensors of several robots share under this key; `make` makes it at the first call."""
        ...

    def own_mechanism(self, spec: ServerSpec, device: Device, robot: int, seed: int) -> Mechanism | None:
        """Return the mechanism of a device that this physics simulates by itself.

        None for a device that needs poses and time alone: `colony.sim.devices` simulates it.

        Args:
            spec: what the device's server offers.
            device: the device of the robot's body.
            robot: the number of the robot.
            seed: seed of the device's noise.
        """
        ...
