"""What a robot reads of its base and of its ring of sonars and infrared detectors."""

from __future__ import annotations

from dataclasses import replace

from colony.ir.servers import PROXIMITY, RSERVER
from colony.ir.types import Value
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseState
from colony.sim.chance import device_seed
from colony.sim.devices.device import TimedMeasurements, faults_of
from colony.sim.mechanism import Measurement
from colony.sim.physics import Physics

_STATE = "state"
_SONAR, _INFRARED = "sonar", "infrared"


class BaseSensors:
    """Odometry, speeds and bumpers of robot number `robot`, not its true pose. Stateful: its measurements."""

    def __init__(self, world: Physics, robot: int) -> None:
        self._world = world
        self._robot = robot
        config = world.configs[robot]
        faults = faults_of(config.base_faults, device_seed(world.seed, robot, RSERVER.name))
        self._measurements = TimedMeasurements(
            self._take, {_STATE: config.base_period_ns}, world, robot, faults
        )

    def state(self, now_ns: int) -> BaseState | None:
        """Return the newest state; None before the first has arrived, or if it is missing.

        Args:
            now_ns: the time that the world has reached, on the Clock.
        """
        newest = self._measurements.newest(_STATE)
        if newest is None:
            return None
        state, age_ns = newest
        t_ns = now_ns - age_ns
        return state if state.t_ns == t_ns else replace(state, t_ns=t_ns)

    def _take(self, name: str) -> Measurement[BaseState]:
        world, robot = self._world, self._robot
        pose, speed, bumper = world.odometry(robot), world.speed(robot), world.bumper(robot)
        state = BaseState(
            t_ns=world.elapsed_ns,
            x=pose.x_mm,
            y=pose.y_mm,
            heading=pose.heading_deg,
            front_bumper=bumper.front,
            rear_bumper=bumper.rear,
            speed=speed.velocity_mm_s,
            turn_rate=speed.turn_deg_s,
            wheel_speed=world.wheel_speed(robot),
            sideways_speed=speed.sideways_mm_s,
        )
        return lambda: state


class RingSensors:
    """Sonars and infrared detectors of robot number `robot`. Stateful: its measurements."""

    def __init__(self, world: Physics, robot: int) -> None:
        self._world = world
        self._robot = robot
        ring = world.configs[robot].ring
        periods_ns = (
            {} if ring is None else {_SONAR: ring.sonar_period_ns, _INFRARED: ring.infrared_period_ns}
        )
        faults = None if ring is None else faults_of(ring.faults, device_seed(world.seed, robot, PROXIMITY))
        self._measurements = TimedMeasurements(self._take, periods_ns, world, robot, faults)

    def sonar(self, now_ns: int) -> Sample | None:
        """Return the newest ranges in mm; None if there are none. See `BaseSensors.state`."""
        return self._newest(_SONAR, now_ns)

    def infrared(self, now_ns: int) -> Sample | None:
        """Return the newest detections; None if there are none. See `BaseSensors.state`."""
        return self._newest(_INFRARED, now_ns)

    def _newest(self, name: str, now_ns: int) -> Sample | None:
        newest = self._measurements.newest(name)
        return None if newest is None else Sample(newest[0], now_ns - newest[1])

    def _take(self, name: str) -> Measurement[Value]:
        ring = self._world.sonar if name == _SONAR else self._world.infrared
        value: Value = tuple(ring(self._robot).tolist())
        return lambda: value
