"""The hardware of simulated robots.

It runs in steps, reports readings, and stops a base that no longer gets commands. It has neither I/O nor a
clock: times are arguments. `colony.sim.plant.process` connects it to sockets.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from colony.ir.types import ScalarValue
from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseState
from colony.sim.compiled import Bytes2
from colony.sim.devices.base import BaseSensors, RingSensors
from colony.sim.drivers import image_of
from colony.sim.mechanism import Given, GivenTimeline, GivenValue
from colony.sim.plant.protocol import FieldReading, RingReadings, Truth
from colony.sim.world.elevators import Elevators
from colony.sim.world.world import World

# --- given --------------------------------------------------------------------------------------------
#
# What the control connections of a plant give for fields of the devices. No I/O.

MAX_GIVEN = 100_000
"""Maximum number of changes that all connections may have given."""


class GivenFields:
    """What is given for fields of the devices of all robots, until its giver withdraws it. Mutable.

    Where several givers give the same field, the one that gave first most recently counts.
    """

    def __init__(self) -> None:
        self._timelines: dict[tuple[object, int], GivenTimeline] = {}

    def give(self, giver: object, robot: int, server: str, field: str, t_ns: int, value: GivenValue) -> None:
        """Give a field of a robot's device a value from a time on.

        Raises:
            ValueError: `MAX_GIVEN` changes have been given.
        """
        if sum(timeline.size for timeline in self._timelines.values()) >= MAX_GIVEN:
            raise ValueError(f"found more than {MAX_GIVEN} changes of fields; expected at most so many")
        self._timelines.setdefault((giver, robot), GivenTimeline()).add(server, field, t_ns, value)

    def withdraw(self, giver: object) -> None:
        """Withdraw all that a giver gave."""
        self._timelines = {key: found for key, found in self._timelines.items() if key[0] is not giver}

    def of(self, robot: int) -> Given:
        """Return the function that returns what is given for the devices of a robot."""

        def value_at(server: str, field: str, now_ns: int) -> GivenValue:
            for (_, number), timeline in reversed(self._timelines.items()):
                value = timeline.value_at(server, field, now_ns) if number == robot else None
                if value is not None:
                    return value
            return None

        return value_at


# --- hardware -----------------------------------------------------------------------------------------

STEP_NS = 20_000_000
"""Step of the simulation in nanoseconds: the period of the reports of a base or a ring."""

WATCHDOG_NS = 500_000_000
"""Time in nanoseconds without a command after which a base stops."""

MAX_LAG_NS = 1_000_000_000
"""Maximum lag in nanoseconds that the plant makes up for.

After a longer lag (for example, because the process was stopped) the time is skipped: nothing moves.
"""


RobotCamera = Callable[[World, int, int], Bytes2]
"""A camera of robots: a function from the world, the number of a robot and the time in ns to the image."""


class RobotDevice(Protocol):
    """Another device of a robot."""

    def sense(self, now_ns: int) -> Mapping[str, Sample | None]:
        """Return the newest reading of each field."""
        ...

    def command(self, name: str, values: Mapping[str, ScalarValue], now_ns: int) -> None:
        """Carry out a command; raise `ValueError` if it is none of the device's."""
        ...

    def safe(self, now_ns: int) -> None:
        """Make the device safe."""
        ...


@dataclass(frozen=False, slots=True, kw_only=True)
class _Command:
    """The time `at_ns` of a base's last command; None after a halt."""

    at_ns: int | None = None


class Devices:
    """The devices of all robots of a world. Stateful: `time_ns` advances in steps of equal length.

    Args:
        world: the robots.
        names: names of the robots, in the order of their numbers.
        cameras: cameras of each robot, by name; each is a function that returns that of the robots' floor.
        devices: the other devices of each robot, by the names of their servers.
        floor: name of the map of the floor, if the robots cannot leave it.
        elevators: the elevators of the robots' building, if they can.
        given: what is given for fields of these devices, which read it.
        now_ns: current time.
        step_ns: step of the simulation.

    Raises:
        ValueError: the names are not one distinct name per robot, or the step is out of range.
    """

    def __init__(
        self,
        world: World,
        names: tuple[str, ...],
        cameras: Mapping[str, Callable[[], RobotCamera]],
        devices: Sequence[Mapping[str, RobotDevice]] = (),
        *,
        floor: str = "",
        elevators: Elevators | None = None,
        given: GivenFields | None = None,
        now_ns: int,
        step_ns: int = STEP_NS,
    ) -> None:
        if len(set(names)) != len(world) or len(names) != len(world):
            raise ValueError(f"{len(world)} robots, named {', '.join(names)}; expected a name for each")
        if not 0 < step_ns <= MAX_LAG_NS:
            raise ValueError(f"steps of {step_ns} ns; expected above 0, up to {MAX_LAG_NS}")
        self._world = world
        self._robots = {name: number for number, name in enumerate(names)}
        self._cameras = cameras
        self._floor, self._elevators = floor, elevators
        self._devices = devices or [{} for _ in names]
        self._given = GivenFields() if given is None else given
        self._commands = [_Command() for _ in names]
        robots = range(len(world))
        self._bases = [BaseSensors(world, robot) for robot in robots]
        self._rings = {robot: RingSensors(world, robot) for robot in robots if world.configs[robot].channels}
        self.step_ns = step_ns
        self._skipped_ns = 0
        self.time_ns = now_ns

    def number(self, robot: str) -> int:
        """Return the number of a robot.

        Raises:
            ValueError: there is no robot of this name.
        """
        try:
            return self._robots[robot]
        except KeyError:
            names = ", ".join(self._robots)
            raise ValueError(f"no robot `{robot}`; the robots are {names}") from None

    def check_camera(self, camera: str) -> None:
        """Check that the robots have a camera of this name.

        Raises:
            ValueError: they do not.
        """
        if camera not in self._cameras:
            names = ", ".join(self._cameras) or "none"
            raise ValueError(f"the robots have no camera `{camera}`; they have {names}")

    def check_proximity(self, robot: int) -> None:
        """Check that a robot has a ring of sonars and infrared detectors.

        Raises:
            ValueError: it has none.
        """
        if robot not in self._rings:
            raise ValueError("the robot has no ring of sonars")

    def check_device(self, robot: int, server: str) -> None:
        """Check that a robot has a device with a server of this name.

        Raises:
            ValueError: it has none.
        """
        if server not in self._devices[robot]:
            names = ", ".join(self._devices[robot]) or "none"
            raise ValueError(f"the robot has no device of `{server}`; it has {names}")

    @property
    def elevators(self) -> Elevators:
        """The elevators of the robots' building.

        Raises:
            ValueError: the robots cannot leave their floor.
        """
        if self._elevators is None:
            raise ValueError(f"no elevators: the simulator has one floor, `{self._floor}`")
        return self._elevators

    # --- time ----------------------------------------------------------------------------------------

    def advance(self, now_ns: int) -> None:
        """Simulate whole steps up to `now_ns`."""
        lag_ns = now_ns - self.time_ns
        if lag_ns > MAX_LAG_NS:
            skipped = lag_ns // self.step_ns * self.step_ns
            self._skipped_ns += skipped
            self.time_ns += skipped
        while self.time_ns + self.step_ns <= now_ns:
            self._stop_expired()
            self._world.advance(self.step_ns / 1e9)
            if self._elevators is not None:
                self._elevators.advance(self.step_ns / 1e9)
            self.time_ns += self.step_ns

    def _stop_expired(self) -> None:
        """Stop the bases whose watchdogs have expired."""
        for robot, command in enumerate(self._commands):
            if command.at_ns is not None and not self._in_time(command.at_ns):
                self.halt(robot)

    def _in_time(self, commanded_ns: int) -> bool:
        return self.time_ns - commanded_ns < WATCHDOG_NS

    # --- commands ------------------------------------------------------------------------------------

    def drive(self, robot: int, velocity: float, turn: float, sideways: float = 0.0) -> None:
        """Set the speeds of a base.

        Raises:
            ValueError: a speed is not finite.
        """
        self._world.command(robot, velocity, turn, sideways)
        self._commands[robot].at_ns = self.time_ns

    def halt(self, robot: int) -> None:
        """Stop a base as fast as it can brake."""
        self._world.command(robot, 0.0, 0.0)
        self._commands[robot].at_ns = None

    def command(self, robot: int, server: str, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Carry out a command of a device.

        Raises:
            ValueError: the device refuses it, or a number is not finite.
        """
        if not all(map(math.isfinite, values.values())):
            raise ValueError(f"the values of `{name}` are {values}; expected finite ones")
        try:
            self._devices[robot][server].command(name, values, self.time_ns)
        except KeyError as missing:
            raise ValueError(f"`{name}` of {server} has no {missing}") from None

    def safe(self, robot: int, server: str) -> None:
        """Make a device safe."""
        self._devices[robot][server].safe(self.time_ns)

    def is_driven(self, robot: int) -> bool:
        """Return True if a base has a recent command."""
        at_ns = self._commands[robot].at_ns
        return at_ns is not None and self._in_time(at_ns)

    def place(self, robot: int, x: float, y: float, heading: float) -> None:
        """Move a robot; raise `ValueError` if it does not fit there, or a number is not finite."""
        self._world.place(robot, (x, y, heading))

    def give(self, giver: object, robot: int, server: str, field: str, t_ns: int, value: GivenValue) -> None:
        """Give a field of a device a value from a time on, until `withdraw`.

        Raises:
            ValueError: the robot has no such device, the device no such field, or too much is given.
        """
        self.check_device(robot, server)
        fields = self._devices[robot][server].sense(self.time_ns)
        if field not in fields:
            raise ValueError(f"{server} has no field `{field}`; it has {', '.join(fields) or 'none'}")
        self._given.give(giver, robot, server, field, t_ns, value)

    def withdraw(self, giver: object) -> None:
        """Withdraw all that a giver gave."""
        self._given.withdraw(giver)

    # --- readings ------------------------------------------------------------------------------------

    def base(self, robot: int) -> BaseState | None:
        """Return the newest state of a base; None before the first has arrived."""
        return self._bases[robot].state(self.time_ns)

    def proximity(self, robot: int) -> RingReadings:
        """Return the newest readings of a robot's rings."""
        ring = self._rings[robot]
        return RingReadings(sonar=ring.sonar(self.time_ns), infrared=ring.infrared(self.time_ns))

    def image(self, robot: int, camera: str) -> Image:
        """Return the image of a robot's camera."""
        see = self._cameras[camera]()
        return image_of(see(self._world, robot, self.time_ns), self.time_ns)

    def device(self, robot: int, server: str) -> Mapping[str, FieldReading | None]:
        """Return the newest readings of a device by field."""
        readings = self._devices[robot][server].sense(self.time_ns)
        return {name: None if s is None else FieldReading(s.value, s.t_ns) for name, s in readings.items()}

    def truth(self, robot: int) -> Truth:
        """Return the true state of a robot."""
        pose, speed = self._world.true_pose(robot), self._world.speed(robot)
        return Truth(
            t_ns=self.time_ns,
            floor=self._floor if self._elevators is None else self._elevators.floor,
            x=pose.x_mm,
            y=pose.y_mm,
            heading=pose.heading_deg,
            velocity=speed.velocity_mm_s,
            turn=speed.turn_deg_s,
            sideways=speed.sideways_mm_s,
            distance=self._world.distance(robot),
            bumps=self._world.bumps(robot),
            driven=self.is_driven(robot),
            skipped_ns=self._skipped_ns,
            people=tuple((x, y) for x, y in self._world.people.tolist()),
        )
