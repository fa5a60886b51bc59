"""The parameters of a simulated robot, from its body."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cache

from colony.body.consistency import radius_mm
from colony.body.model import Body
from colony.body.shipped import shipped_body
from colony.runtime.servers.drivers import BaseLimits

ROME = "rome"
"""The robot that is simulated where nothing else is said."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotConfig:
    """A differential-drive robot with a round hull; lengths in mm, angles in degrees, times in seconds.

    Attributes:
        channels: number of sonars, and of infrared detectors: a ring that closes, counterclockwise.
        ahead: the channel that looks straight ahead.
        radius_mm: radius of the hull, which is a bumper all around.
        wheel_base_mm: distance between the wheels.
        max_velocity_mm_s, max_turn_deg_s: limits of the commands, in either direction.
        acceleration_mm_s2, turn_acceleration_deg_s2: accelerations toward the commanded speeds.
        sonar_ring_mm: distance of the transducers from the robot's center; ranges are measured from
            the transducer.
        sonar_range_mm: the reading without an echo.
        sonar_min_mm: the smallest reading.
        sonar_half_beam_deg: half the beam width of a transducer, below 90.
        sonar_critical_deg: critical angle to the normal, beyond which a wall reflects the sound away.
        sonar_noise_mm, sonar_noise: standard deviation of an echo: a constant, plus a multiple of the range.
        infrared_range_mm: range from the ring of transducers, without noise.
        infrared_wired: the channels that have a detector; the others never detect anything.
        wheel_scale: standard deviation of each wheel's scale error, drawn once per robot (0.01 is 1 %).
        wheel_slip_mm: standard deviation of a wheel's error over the first meter; over d meters it is sqrt(d)
            times as much.

    Raises:
        ValueError: a number is not finite, or out of range.
    """

    channels: int
    ahead: int
    radius_mm: float
    wheel_base_mm: float
    max_velocity_mm_s: float
    max_turn_deg_s: float
    acceleration_mm_s2: float
    turn_acceleration_deg_s2: float
    sonar_ring_mm: float
    sonar_range_mm: float
    sonar_min_mm: float
    sonar_half_beam_deg: float
    sonar_critical_deg: float
    sonar_noise_mm: float
    sonar_noise: float
    infrared_range_mm: float
    infrared_wired: tuple[int, ...]
    wheel_scale: float
    wheel_slip_mm: float

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        zero_allowed = {"sonar_min_mm", "sonar_noise_mm", "sonar_noise", "wheel_scale", "wheel_slip_mm"}
        zero_allowed |= {"sonar_half_beam_deg", "sonar_critical_deg"}
        for field in fields(self):
            if field.name in ("infrared_wired", "channels", "ahead"):
                continue
            value = getattr(self, field.name)
            expected = "at least 0" if field.name in zero_allowed else "above 0"
            if not (math.isfinite(value) and (value > 0 or (value == 0 and field.name in zero_allowed))):
                raise ValueError(f"{field.name} is {value!r}; expected a finite number {expected}")
        if self.sonar_half_beam_deg >= 90.0 or self.sonar_critical_deg > 90.0:
            raise ValueError("the sonar's half beam and critical angle are below 90 degrees")
        if self.sonar_ring_mm > self.radius_mm:
            raise ValueError(
                f"sonar_ring_mm is {self.sonar_ring_mm}; expected at most radius_mm, {self.radius_mm}"
            )
        if not 0 <= self.ahead < self.channels:
            raise ValueError(f"ahead is {self.ahead}; expected a channel from 0 to {self.channels - 1}")
        if not all(0 <= channel < self.channels for channel in self.infrared_wired):
            raise ValueError(
                f"infrared_wired is {self.infrared_wired}; expected channels from 0 to {self.channels - 1}"
            )

    @property
    def spacing_deg(self) -> float:
        """The angle between neighboring channels."""
        return 360.0 / self.channels


def config_of(body: Body) -> RobotConfig:
    """Return the parameters of a robot with this body.

    Raises:
        ValueError: the simulator cannot simulate it: it has no ring of sonars, more than one, or a ring that
            does not close, or in which nothing looks straight ahead.
    """
    ring = body.ring()
    drive, limits, sonar = body.chassis.drive, body.chassis.limits, ring.sonar
    wired = ring.infrared.wired
    return RobotConfig(
        channels=ring.count,
        ahead=ring.ahead,
        radius_mm=radius_mm(body),
        wheel_base_mm=drive.wheel_base_mm,
        max_velocity_mm_s=limits.velocity_mm_s,
        max_turn_deg_s=limits.turn_deg_s,
        acceleration_mm_s2=limits.acceleration_mm_s2,
        turn_acceleration_deg_s2=limits.turn_acceleration_deg_s2,
        sonar_ring_mm=ring.ring_mm,
        sonar_range_mm=sonar.range_mm,
        sonar_min_mm=sonar.nearest_mm,
        sonar_half_beam_deg=sonar.half_beam_deg,
        sonar_critical_deg=sonar.critical_deg,
        sonar_noise_mm=sonar.noise_mm,
        sonar_noise=sonar.noise_fraction,
        infrared_range_mm=ring.infrared.range_mm,
        infrared_wired=tuple(range(ring.count)) if wired is None else wired,
        wheel_scale=drive.scale_error,
        wheel_slip_mm=drive.slip_mm,
    )


@cache
def rome_config() -> RobotConfig:
    """Return the parameters of RoME."""
    return config_of(shipped_body(ROME))


def without_errors(config: RobotConfig) -> RobotConfig:
    """Return a robot without errors: its sensors are exact, and its odometry is the true pose."""
    return replace(config, sonar_noise_mm=0.0, sonar_noise=0.0, wheel_scale=0.0, wheel_slip_mm=0.0)


def limits_of(config: RobotConfig) -> BaseLimits:
    """Return the limits of the robot's base."""
    return BaseLimits(
        velocity=config.max_velocity_mm_s,
        turn=config.max_turn_deg_s,
        acceleration=config.acceleration_mm_s2,
        turn_acceleration=config.turn_acceleration_deg_s2,
    )
