"""Drivers of simulated devices, for the servers of a robot.

Several robots may share a world and a clock. The world catches up with the clock whenever a device is read or
commanded, so that time is the same for all robots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from colony.body.model import Body
from colony.body.servers import servers_of
from colony.body.shipped import ROME, shipped_body
from colony.ir.servers import ServerSpec
from colony.ir.types import ScalarValue
from colony.runtime.protocol.images import Image, Shot
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseState, CameraDriver, Drivers, Reading
from colony.sim.compiled import Bytes2
from colony.sim.config import limits_of
from colony.sim.devices import SimulatedDevice, devices_of
from colony.sim.devices.base import BaseSensors, RingSensors
from colony.sim.mechanism import Given, nothing_given
from colony.sim.physics import Physics
from colony.sim.timeline import MAX_STEP_S


class Companion(Protocol):
    """Another robot of a world, which is run frame by frame while the world catches up with a clock."""

    @property
    def due_ns(self) -> int:
        """The time of its next frame."""
        ...

    def run_frame(self) -> None:
        """Run this frame, in the world as it is at this time."""
        ...


class Plant:
    """A world that is kept in step with a clock in nanoseconds. Stateful: remembers the simulated time.

    `step_callbacks` are called after each step, with its length in seconds. They move everything that is
    neither a robot nor a person; an example is `colony.sim.world.elevators.Elevators.advance`.

    Steps end where a companion's frame is due. It is run before the world goes on, after whatever the clock's
    own robot did at the same time; companions that are due together run in the order in which they joined.
    """

    def __init__(
        self, world: Physics, clock: Callable[[], int], step_callbacks: Sequence[Callable[[float], None]] = ()
    ) -> None:
        self.world = world
        self._clock = clock
        self._step_callbacks = tuple(step_callbacks)
        self._simulated_ns = clock()
        self._companions: list[Companion] = []
        self._runs_companion = False

    def join(self, companion: Companion) -> None:
        """Run a companion from now on. Its drivers may use this plant: while it runs, the time is its own."""
        self._companions.append(companion)

    def catch_up(self) -> int:
        """Advance the world to the clock's time, and return that time."""
        if self._runs_companion:
            return self._simulated_ns
        now = self._clock()
        while self._simulated_ns < now:
            step = min(now - self._simulated_ns, int(MAX_STEP_S * 1e9))
            if self._companions:
                step = min(step, self._run_companions() - self._simulated_ns)
            self.world.advance(step / 1e9)
            for callback in self._step_callbacks:
                callback(step / 1e9)
            self._simulated_ns += step
        return now

    def _run_companions(self) -> int:
        """Run the frames that are due, and return the time of the next one."""
        self._runs_companion = True
        try:
            for companion in self._companions:
                while companion.due_ns <= self._simulated_ns:
                    companion.run_frame()
        finally:
            self._runs_companion = False
        return min(companion.due_ns for companion in self._companions)


class SimulatedBase:
    """The base of robot number `robot`. Stateful: caches its latest state."""

    register_bits: int | None = None

    def __init__(self, plant: Plant, robot: int) -> None:
        self._plant = plant
        self._robot = robot
        self._sensors = BaseSensors(plant.world, robot)
        self._state: BaseState | None = None
        self.limits = limits_of(plant.world.configs[robot])

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> None:
        """Command the speeds of the base, after the world has caught up with the clock."""
        self._plant.catch_up()
        self._plant.world.command(self._robot, velocity, turn, sideways)

    def stop(self) -> None:
        """Command the base to stop."""
        self.drive(0.0, 0.0)

    def state(self) -> BaseState | None:
        """Return the base's newest state; None before the first has arrived."""
        now = self._plant.catch_up()
        if self._state is None or self._state.t_ns != now:
            found = self._sensors.state(now)
            if found != self._state:
                self._state = found
        return self._state


class SimulatedProximity:
    """The sonars and infrared detectors of robot number `robot`."""

    def __init__(self, plant: Plant, robot: int) -> None:
        self._plant = plant
        self._sensors = RingSensors(plant.world, robot)
        self.count = plant.world.configs[robot].channels

    def sonar(self) -> Sample | None:
        """Return the newest sonar readings; None before the first have arrived."""
        return self._sensors.sonar(self._plant.catch_up())

    def infrared(self) -> Sample | None:
        """Return the newest infrared readings; None before the first have arrived."""
        return self._sensors.infrared(self._plant.catch_up())


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


class SimulatedDriver:
    """The driver of a simulated device, which has a server of its own."""

    def __init__(self, plant: Plant, device: SimulatedDevice) -> None:
        self._plant = plant
        self._device = device

    def fields(self) -> Mapping[str, Reading | None]:
        """Return the fields now, with the ages of their measurements."""
        now = self._plant.catch_up()
        return {name: _reading(sample, now) for name, sample in self._device.sense(now).items()}

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Carry out a command now."""
        self._device.command(name, values, self._plant.catch_up())

    def safe(self) -> None:
        """Make the device safe now."""
        self._device.safe(self._plant.catch_up())

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


def _reading(sample: Sample | None, now_ns: int) -> Reading | None:
    return None if sample is None else Reading(sample.value, now_ns - sample.t_ns)


def simulated_drivers(
    plant: Plant,
    robot: int = 0,
    *,
    body: Body | None = None,
    servers: tuple[ServerSpec, ...] | None = None,
    seed: int = 0,
    given: Given = nothing_given,
    cameras: Mapping[str, CameraDriver] | None = None,
) -> Drivers:
    """Return all devices of one simulated robot.

    Args:
        plant: the world and its clock.
        robot: the number of the robot.
        body: the robot's body, from which its parameters in the world are; by default that of RoME.
        servers: what its servers offer; by default what follows from its body alone.
        seed: seed of the noise of its devices, apart from that of base and sonars, which the world has.
        given: what fields of devices read in place of what they measure.
        cameras: the cameras, by the names of their servers.
    """
    body = shipped_body(ROME) if body is None else body
    servers = servers_of(body) if servers is None else servers
    devices = devices_of(body, servers, plant.world, robot, seed=seed, given=given)
    return Drivers(
        servers=servers,
        base=None if body.base is None else SimulatedBase(plant, robot),
        proximity=SimulatedProximity(plant, robot) if body.has_ring() else None,
        cameras=cameras or {},
        devices={name: SimulatedDriver(plant, device) for name, device in devices.items()},
    )
