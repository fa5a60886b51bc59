"""The parameters of the simulated robot: RoME, a TRC Labmate with a ring of sonars."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from colony.runtime.servers.drivers import BaseLimits

CHANNELS = 24
"""Number of sonars, and of infrared channels, 15 degrees apart counterclockwise: 12 is ahead, 18 left."""

SPACING_DEG = 360.0 / CHANNELS
AHEAD = CHANNELS // 2


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotConfig:
    """A differential-drive robot with a round hull; lengths in mm, angles in degrees, times in seconds.

    Attributes:
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

    radius_mm: float = 400.0
    wheel_base_mm: float = 340.0
    max_velocity_mm_s: float = 600.0
    max_turn_deg_s: float = 90.0
    acceleration_mm_s2: float = 800.0
    turn_acceleration_deg_s2: float = 240.0
    sonar_ring_mm: float = 360.0
    sonar_range_mm: float = 10_000.0
    sonar_min_mm: float = 100.0
    sonar_half_beam_deg: float = 12.0
    sonar_critical_deg: float = 30.0
    sonar_noise_mm: float = 3.0
    sonar_noise: float = 0.003
    infrared_range_mm: float = 760.0
    infrared_wired: tuple[int, ...] = tuple(range(CHANNELS))
    wheel_scale: float = 0.003
    wheel_slip_mm: float = 3.0

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        zero_allowed = {"sonar_min_mm", "sonar_noise_mm", "sonar_noise", "wheel_scale", "wheel_slip_mm"}
        zero_allowed |= {"sonar_half_beam_deg", "sonar_critical_deg"}
        for field in fields(self):
            if field.name == "infrared_wired":
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
        if not all(0 <= channel < CHANNELS for channel in self.infrared_wired):
            raise ValueError(
                f"infrared_wired is {self.infrared_wired}; expected channels from 0 to {CHANNELS - 1}"
            )


IDEAL = RobotConfig(sonar_noise_mm=0.0, sonar_noise=0.0, wheel_scale=0.0, wheel_slip_mm=0.0)
"""RoME without errors: sensors are exact, and the odometry is the true pose."""


def limits_of(config: RobotConfig) -> BaseLimits:
    """Return the limits of the robot's base."""
    return BaseLimits(
        velocity=config.max_velocity_mm_s,
        turn=config.max_turn_deg_s,
        acceleration=config.acceleration_mm_s2,
        turn_acceleration=config.turn_acceleration_deg_s2,
    )
