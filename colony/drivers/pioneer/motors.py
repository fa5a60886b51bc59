"""The motors' controller of an emulated Pioneer: commands to set points, set points to speeds. Pure.

The robot translates at a speed or by a distance, and turns at a rate or to a heading. Each set point holds
until another of its kind comes. Distances and headings are approached at most at the speeds of SETV and
SETRV, and so that the deceleration suffices.
"""

from __future__ import annotations

import math

from colony.drivers.emulator import STEP_S
from colony.drivers.pioneer.codec import Command
from colony.drivers.pioneer.parameters import Parameters

ABRUPT = 4000.0
"""Deceleration without a ramp, in mm/s^2 and deg/s^2."""

MAX_SPEED, MAX_TURN = 750, 100
"""Speeds of moves and turns until others are set, in mm/s and deg/s."""

ACCELERATION, TURN_ACCELERATION = 300, 100
"""Accelerations and decelerations until others are set, in mm/s^2 and deg/s^2."""

WHEEL_UNIT = 20
"""Unit of a wheel's speed in VEL2, in mm/s."""

RESERVE = 0.8
"""Part of the deceleration with which distances and headings are approached."""


class Motors:
    """The controller. Mutable.

    Attributes:
        speed, turn: speeds as they are, in mm/s and deg/s.
        max_speed, max_turn: speeds of moves and turns.
        acceleration, deceleration, turn_acceleration, turn_deceleration: its ramps.
        is_estopped: whether it stands until it is commanded to move, or enabled.
    """

    def __init__(self, row: Parameters) -> None:
        self._row = row
        self.speed = self.turn = 0.0
        self.reset()

    def reset(self) -> None:
        """Forget all set points and settings."""
        self.max_speed = min(MAX_SPEED, self._row.max_speed)
        self.max_turn = min(MAX_TURN, self._row.max_turn)
        self.acceleration = self.deceleration = ACCELERATION
        self.turn_acceleration = self.turn_deceleration = TURN_ACCELERATION
        self.is_estopped = False
        self.halt()

    def halt(self) -> None:
        """Set both speeds to 0."""
        self._velocity = self._rate = 0.0
        self._distance: float | None = None
        self._heading: float | None = None

    @property
    def set_points(self) -> tuple[float, float]:
        """The latched speeds, in mm/s and deg/s, which it resumes once it may."""
        return self._velocity, self._rate

    @property
    def ahead(self) -> float:
        """The speed in mm/s or the distance in mm that it is to go, negative backward."""
        return self._velocity if self._distance is None else self._distance

    def obey(self, number: int, value: int, heading: float, origin: float) -> None:
        """Take a command; other commands than those of motion change nothing.

        Args:
            number: the command.
            value: its argument.
            heading: the robot's, in degrees.
            origin: the heading that the robot calls 0.
        """
        match number:
            case Command.VEL:
                self._translate(value)
            case Command.RVEL | Command.ROTATE:
                self._rotate(value)
            case Command.VEL2:
                right, left = (WHEEL_UNIT * _signed_byte(value >> shift) for shift in (0, 8))
                self._translate((left + right) / 2.0)
                self._rotate(self._row.turn_rate(left, right))
            case Command.MOVE:
                self._translate(0.0, distance=float(value))
            case Command.HEAD:
                self._rotate(0.0, heading=origin + value)
            case Command.DHEAD:
                self._rotate(0.0, heading=heading + value)
            case Command.STOP | Command.ESTOP:
                self.halt()
                self.is_estopped = number == Command.ESTOP
            case _:
                self._set(number, value)

    def _set(self, number: int, value: int) -> None:
        match number:
            case Command.SETV:
                self.max_speed = min(value, self._row.max_speed)
            case Command.SETRV:
                self.max_turn = min(value, self._row.max_turn)
            case Command.SETA if value > 0:
                self.acceleration = value
            case Command.SETA:
                self.deceleration = -value
            case Command.SETRA if value > 0:
                self.turn_acceleration = value
            case Command.SETRA:
                self.turn_deceleration = -value
            case _:
                pass

    def _translate(self, velocity: float, distance: float | None = None) -> None:
        self._velocity, self._distance = float(velocity), distance
        self.is_estopped = self.is_estopped and not velocity and distance is None

    def _rotate(self, rate: float, heading: float | None = None) -> None:
        self._rate, self._heading = float(rate), heading
        self.is_estopped = self.is_estopped and not rate and heading is None

    def step(
        self, heading: float, *, drives: bool, is_off: bool, joystick: tuple[float, float] | None = None
    ) -> None:
        """Let `STEP_S` pass.

        Args:
            heading: the robot's, in degrees.
            drives: whether it may drive at all.
            is_off: whether the motors are off, so that it stops without a ramp.
            joystick: speeds in place of the set points.
        """
        drives = drives and not self.is_estopped
        wanted, rate = (self._wanted_speed(), self._wanted_rate(heading)) if drives else (0.0, 0.0)
        if joystick is not None:
            wanted, rate = joystick
        is_abrupt = is_off or self.is_estopped
        brakes, turn_brakes = (ABRUPT, ABRUPT) if is_abrupt else (self.deceleration, self.turn_deceleration)
        self.speed = _towards(self.speed, _bounded(wanted, self._row.max_speed), self.acceleration, brakes)
        self.turn = _towards(
            self.turn, _bounded(rate, self._row.max_turn), self.turn_acceleration, turn_brakes
        )
        if drives and self._distance is not None:
            self._distance -= self.speed * STEP_S

    def _wanted_speed(self) -> float:
        if self._distance is None:
            return self._velocity
        return _approach(self._distance, self.max_speed, self.deceleration)

    def _wanted_rate(self, heading: float) -> float:
        if self._heading is None:
            return self._rate
        left = math.remainder(self._heading - heading, 360.0)
        return _approach(left, self.max_turn, self.turn_deceleration)

    def wheels(self) -> tuple[float, float]:
        """Return the speeds of the left and the right wheel, in mm/s."""
        half = math.radians(self.turn) / self._row.turn_per_speed
        return self.speed - half, self.speed + half


def _signed_byte(value: int) -> int:
    return (value + 0x80) % 0x100 - 0x80


def _bounded(value: float, most: float) -> float:
    return max(-most, min(most, value))


def _approach(left: float, most: float, deceleration: float) -> float:
    """Return the speed at which what is left is to be covered."""
    speed = min(most, math.sqrt(2.0 * RESERVE * deceleration * abs(left)), abs(left) / STEP_S)
    return math.copysign(speed, left)


def _towards(now: float, wanted: float, acceleration: float, deceleration: float) -> float:
    """Return the speed after a step toward the wanted one."""
    slows = abs(wanted) < abs(now) or now * wanted < 0.0
    most = (deceleration if slows else acceleration) * STEP_S
    return now + max(-most, min(most, wanted - now))
