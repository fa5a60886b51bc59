"""The parameters of a simulated robot, from its body."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

from colony.body.devices import MountPose
from colony.body.model import Body, DeviceFaults, Drive, Omnidirectional, Rolling, radius_mm, rolling_at
from colony.body.shipped import ROME, shipped_body
from colony.ir.servers import RSERVER
from colony.runtime.servers.drivers import BaseLimits
from colony.text.wording import listed


@dataclass(frozen=True, slots=True, kw_only=True)
class RingConfig:
    """A ring of sonars and infrared detectors; lengths in mm, angles in degrees.

    Attributes:
        channels: number of sonars, and of infrared detectors: a ring that closes, counterclockwise.
        ahead: the channel that looks straight ahead.
        ring_mm: distance of the transducers from the robot's center; ranges are measured from the transducer.
        sonar_range_mm: the reading without an echo.
        sonar_min_mm: the smallest reading.
        sonar_half_beam_deg: half the beam width of a transducer, below 90.
        sonar_critical_deg: critical angle to the normal, beyond which a wall reflects the sound away.
        sonar_noise_mm, sonar_noise: standard deviation of an echo: a constant, plus a multiple of the range.
        infrared_range_mm: range from the ring of transducers, without noise.
        infrared_wired: the channels that have a detector; the others never detect anything.
        sonar_period_ns, infrared_period_ns: time between two measurements; None if they are measured when
            they are read.
        faults: the faults of what they measure.

    Raises:
        ValueError: a number is not finite, or out of range.
    """

    channels: int
    ahead: int
    ring_mm: float
    sonar_range_mm: float
    sonar_min_mm: float
    sonar_half_beam_deg: float
    sonar_critical_deg: float
    sonar_noise_mm: float
    sonar_noise: float
    infrared_range_mm: float
    infrared_wired: tuple[int, ...]
    sonar_period_ns: int | None
    infrared_period_ns: int | None
    faults: DeviceFaults | None

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        _check_positive(self, "ring_mm", "sonar_range_mm", "infrared_range_mm")
        _check_not_negative(
            self, "sonar_min_mm", "sonar_half_beam_deg", "sonar_critical_deg", "sonar_noise_mm", "sonar_noise"
        )
        if self.sonar_half_beam_deg >= 90.0 or self.sonar_critical_deg > 90.0:
            raise ValueError("the sonar's half beam and critical angle are below 90 degrees")
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotConfig:
    """A robot with a round hull; lengths in mm, angles in degrees, times in nanoseconds.

    Attributes:
        radius_mm: radius of the hull, which is a bumper all around.
        wheel_base_mm: distance between the left and the right wheel of a robot with two.
        max_velocity_mm_s, max_turn_deg_s: limits of the commands, in either direction.
        acceleration_mm_s2, turn_acceleration_deg_s2: accelerations toward the commanded speeds.
        wheel_scale: standard deviation of each wheel's scale error, drawn once per robot (0.01 is 1 %).
        wheel_slip_mm: standard deviation of a wheel's error over the first meter; over d meters it is sqrt(d)
            times as much.
        command_delay_ns: time from a command, to the base or another device, until it takes effect.
        reading_delay_ns: time from a measurement until it arrives; images arrive at once.
        base_period_ns: time between two measurements of the base; None if it is measured when it is read.
        base_faults: the faults of what the base measures.
        ring: its ring of sonars and infrared detectors, if it has one.
        omni_wheels: the wheels of a robot that drives sideways; none for one with two wheels.
        max_sideways_mm_s, sideways_acceleration_mm_s2: limit of the sideways command in either direction, and
            the acceleration toward it; 0 for a robot with two wheels.

    Raises:
        ValueError: a number is not finite, or out of range, or the ring is outside the hull.
    """

    radius_mm: float
    wheel_base_mm: float
    max_velocity_mm_s: float
    max_turn_deg_s: float
    acceleration_mm_s2: float
    turn_acceleration_deg_s2: float
    wheel_scale: float
    wheel_slip_mm: float
    command_delay_ns: int
    reading_delay_ns: int
    base_period_ns: int | None
    base_faults: DeviceFaults | None
    ring: RingConfig | None
    omni_wheels: tuple[Rolling, ...]
    max_sideways_mm_s: float
    sideways_acceleration_mm_s2: float

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        _check_positive(self, "radius_mm", "wheel_base_mm", "max_velocity_mm_s", "max_turn_deg_s")
        _check_positive(self, "acceleration_mm_s2", "turn_acceleration_deg_s2")
        _check_not_negative(self, "wheel_scale", "wheel_slip_mm", "command_delay_ns", "reading_delay_ns")
        if self.is_omnidirectional:
            _check_positive(self, *_SIDEWAYS)
        elif any(getattr(self, name) for name in _SIDEWAYS):
            raise ValueError(f"expected {listed(_SIDEWAYS)} to be 0 without `omni_wheels`")
        if self.ring is not None and self.ring.ring_mm > self.radius_mm:
            raise ValueError(f"ring_mm is {self.ring.ring_mm}; expected at most radius_mm, {self.radius_mm}")

    def bounded(
        self, velocity_mm_s: float, turn_deg_s: float, sideways_mm_s: float = 0.0
    ) -> tuple[float, float, float]:
        """Return commanded speeds within the limits.

        Raises:
            ValueError: a speed is not finite.
        """
        speeds = (velocity_mm_s, turn_deg_s, sideways_mm_s)
        if not all(map(math.isfinite, speeds)):
            raise ValueError(f"the speeds are {listed(list(map(str, speeds)), 'and')}; expected finite ones")
        velocity, turn, sideways = self.max_velocity_mm_s, self.max_turn_deg_s, self.max_sideways_mm_s
        return (
            min(max(velocity_mm_s, -velocity), velocity),
            min(max(turn_deg_s, -turn), turn),
            min(max(sideways_mm_s, -sideways), sideways),
        )

    @property
    def is_omnidirectional(self) -> bool:
        """True for a robot that drives sideways, False for one with two wheels."""
        return bool(self.omni_wheels)

    @property
    def wheels(self) -> tuple[Rolling, ...]:
        """The wheels that measure its motion: left and right, or `omni_wheels`."""
        half = self.wheel_base_mm / 2.0
        return self.omni_wheels or (Rolling(1.0, 0.0, -half), Rolling(1.0, 0.0, half))

    @property
    def channels(self) -> int:
        """The number of sonars, and of infrared detectors; 0 without a ring."""
        return 0 if self.ring is None else self.ring.channels


_SIDEWAYS = ("max_sideways_mm_s", "sideways_acceleration_mm_s2")


def _check_positive(config: RingConfig | RobotConfig, *names: str) -> None:
    for name in names:
        value = getattr(config, name)
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} is {value!r}; expected a finite number above 0")


def _check_not_negative(config: RingConfig | RobotConfig, *names: str) -> None:
    for name in names:
        value = getattr(config, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} is {value!r}; expected a finite number at least 0")


def config_of(body: Body) -> RobotConfig:
    """Return the parameters of a robot with this body. A polygon counts as the circle around it.

    Raises:
        ValueError: the simulator cannot simulate it: it has more than one ring of sonars, or one that does
            not close, or in which nothing looks straight ahead.
    """
    drive, limits, delays = body.chassis.drive, body.chassis.limits, body.chassis.delays
    return RobotConfig(
        radius_mm=radius_mm(body),
        wheel_base_mm=drive.wheel_base_mm or 2.0 * radius_mm(body),
        max_velocity_mm_s=limits.velocity_mm_s,
        max_turn_deg_s=limits.turn_deg_s,
        acceleration_mm_s2=limits.acceleration_mm_s2,
        turn_acceleration_deg_s2=limits.turn_acceleration_deg_s2,
        wheel_scale=drive.scale_error,
        wheel_slip_mm=drive.slip_mm,
        command_delay_ns=round(delays.command_s * 1e9),
        reading_delay_ns=round(delays.reading_s * 1e9),
        base_period_ns=_base_period_ns(body),
        base_faults=None if body.base is None else body.base.faults,
        ring=_ring_of(body) if body.has_ring() else None,
        omni_wheels=_omni_wheels(drive, radius_mm(body)),
        max_sideways_mm_s=body.chassis.sideways_mm_s,
        sideways_acceleration_mm_s2=body.chassis.sideways_acceleration_mm_s2,
    )


def _omni_wheels(drive: Drive, radius_mm: float) -> tuple[Rolling, ...]:
    """Return the wheels of a drive that are not just left and right.

    Three at the edge of the hull stand for those that an omnidirectional drive does not describe.
    """
    if not isinstance(drive, Omnidirectional):
        return ()
    edge = (MountPose(radius_mm * cos, radius_mm * sin, direction) for cos, sin, direction in _TRIANGLE)
    return drive.rolling or tuple(map(rolling_at, edge))


_TRIANGLE = ((0.5, math.sqrt(0.75), 150.0), (-1.0, 0.0, -90.0), (0.5, -math.sqrt(0.75), 30.0))


def _base_period_ns(body: Body) -> int | None:
    """Return the period of the base, whose fields are measured together: the shortest of their periods."""
    base = body.base
    periods_ns = [] if base is None else [base.period_ns(field.name) for field in RSERVER.fields]
    known_ns = [period_ns for period_ns in periods_ns if period_ns is not None]
    return min(known_ns) if known_ns and len(known_ns) == len(periods_ns) else None


def _ring_of(body: Body) -> RingConfig:
    ring = body.ring()
    server = next(server for server in body.servers.values() if server.simulated is ring)
    sonar, wired = ring.sonar, ring.infrared.wired
    return RingConfig(
        channels=ring.count,
        ahead=ring.ahead,
        ring_mm=ring.ring_mm,
        sonar_range_mm=sonar.range_mm,
        sonar_min_mm=sonar.nearest_mm,
        sonar_half_beam_deg=sonar.half_beam_deg,
        sonar_critical_deg=sonar.critical_deg,
        sonar_noise_mm=sonar.noise_mm,
        sonar_noise=sonar.noise_fraction,
        infrared_range_mm=ring.infrared.range_mm,
        infrared_wired=tuple(range(ring.count)) if wired is None else wired,
        sonar_period_ns=server.period_ns("sonar"),
        infrared_period_ns=server.period_ns("infrared"),
        faults=server.faults,
    )


@cache
def rome_config() -> RobotConfig:
    """Return the parameters of RoME."""
    return config_of(shipped_body(ROME))


def without_errors(config: RobotConfig) -> RobotConfig:
    """Return a robot without errors: its sensors are exact, and its odometry is the true pose."""
    ring = config.ring
    if ring is not None:
        ring = replace(ring, sonar_noise_mm=0.0, sonar_noise=0.0, faults=None)
    return replace(config, ring=ring, base_faults=None, wheel_scale=0.0, wheel_slip_mm=0.0)


def limits_of(config: RobotConfig) -> BaseLimits:
    """Return the limits of the robot's base."""
    return BaseLimits(
        velocity=config.max_velocity_mm_s,
        turn=config.max_turn_deg_s,
        acceleration=config.acceleration_mm_s2,
        turn_acceleration=config.turn_acceleration_deg_s2,
        sideways=config.max_sideways_mm_s,
        sideways_acceleration=config.sideways_acceleration_mm_s2,
    )
