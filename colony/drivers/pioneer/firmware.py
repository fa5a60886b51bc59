"""What runs in an emulated Pioneer: the session, the base with its motors, sonars, bumpers and battery. Pure.

Bytes go in and packets come out; time passes in steps of 5 ms, as in the robot. What is around the robot is a
function. The robot stands at first in the middle of its registers, x ahead, y to the left.

It does what the manuals say, and what others met: positions wrap at 15 bits, a standard packet has only the
sonars that fired since the last one, the watchdog stops the motors and the next command lets them go on.
"""

from __future__ import annotations

import math
import struct

from colony.drivers.emulator import STEP_S, Surroundings, moved, open_field
from colony.drivers.pioneer.codec import CommandNumber, argument_of, decoder, encoded
from colony.drivers.pioneer.parameters import Parameters, SonarPose

# --- motors -------------------------------------------------------------------------------------------
#
# The motors' controller of an emulated Pioneer: commands to set points, set points to speeds. Pure.
#
# The robot translates at a speed or by a distance, and turns at a rate or to a heading. Each set point holds
# until another of its kind comes. Distances and headings are approached at most at the speeds of SETV and
# SETRV, and so that the deceleration suffices.

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
            case CommandNumber.VEL:
                self._translate(value)
            case CommandNumber.RVEL | CommandNumber.ROTATE:
                self._rotate(value)
            case CommandNumber.VEL2:
                right, left = (WHEEL_UNIT * _signed_byte(value >> shift) for shift in (0, 8))
                self._translate((left + right) / 2.0)
                self._rotate(self._row.turn_rate(left, right))
            case CommandNumber.MOVE:
                self._translate(0.0, distance=float(value))
            case CommandNumber.HEAD:
                self._rotate(0.0, heading=origin + value)
            case CommandNumber.DHEAD:
                self._rotate(0.0, heading=heading + value)
            case CommandNumber.STOP | CommandNumber.ESTOP:
                self.halt()
                self.is_estopped = number == CommandNumber.ESTOP
            case _:
                self._set(number, value)

    def _set(self, number: int, value: int) -> None:
        match number:
            case CommandNumber.SETV:
                self.max_speed = min(value, self._row.max_speed)
            case CommandNumber.SETRV:
                self.max_turn = min(value, self._row.max_turn)
            case CommandNumber.SETA if value > 0:
                self.acceleration = value
            case CommandNumber.SETA:
                self.deceleration = -value
            case CommandNumber.SETRA if value > 0:
                self.turn_acceleration = value
            case CommandNumber.SETRA:
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


# --- firmware -----------------------------------------------------------------------------------------

FIRE_S = 0.04  # time between two sonars of one array, as delivered
ARRAY = 8  # sonars of an array, which fire in turn
SONAR_MAX_MM = 5000.0
HALF_BEAM_DEG = 12.0
RADIUS_MM = 300.0
TOUCH_MM = 8.0
FULL_V, DRAIN_V_PER_S = 12.8, 0.0001


class PioneerFirmware:
    """The robot. Mutable.

    Attributes:
        pose: x and y in mm, and the heading in degrees, as it is; the registers show it in their units.
        stop_button: whether its button is pressed, which switches the motors off; volts: its battery's.
        joystick: speeds of a joystick at its own port, while its button is pressed.
        touched: whether something presses its front bumper, besides what is around.
        bump_stall: bumpers at which it stalls by itself: 1 in front, 2 behind.
    """

    def __init__(
        self,
        row: Parameters,
        *,
        around: Surroundings = open_field,
        watchdog_ms: int = 2000,
        cycle_ms: int = 100,
        bumpers: int = 5,
    ) -> None:
        self._row, self._around = row, around
        self._watchdog_ms, self._cycle_s, self._bumpers = watchdog_ms, cycle_ms / 1000.0, bumpers
        self._decoder = decoder()
        self._out: list[bytes] = []
        self.pose, self._motion = (0.0, 0.0, 0.0), Motors(row)
        self.stop_button, self.touched, self.volts = False, False, FULL_V
        self.joystick: tuple[float, float] | None = None
        self._encoders = [0.0, 0.0]
        self._reset()

    def _reset(self) -> None:
        """Begin without a session."""
        self._synced, self.is_open = 0, False
        self.motors = self._sonar_on = False
        self._motion.reset()
        self._origin = (0.0, 0.0, 0.0)
        self._silent_s = self._packet_s = 0.0
        self._fired: list[tuple[int, int]] = []
        self._fire_s, self._next, self._cycle_of_sonars_s = 0.0, 0, FIRE_S
        self.bump_stall, self._joystick_drives = 0, False
        self._streams_encoders = False

    # --- the line ------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Take bytes from the host."""
        for packet in self._decoder.feed(data):
            self._silent_s = 0.0
            if self.is_open:
                self._obey(packet[0], argument_of(packet))
            else:
                self._greet(packet[0])

    def sent(self) -> list[bytes]:
        """Return what is to be sent, oldest first, and forget it."""
        out, self._out = self._out, []
        return out

    def _greet(self, number: int) -> None:
        if self._synced == 3 and number == CommandNumber.OPEN:
            self.is_open = self._sonar_on = True  # its sonars fire from the beginning of a session
            self._origin = self.pose
        elif number == self._synced:
            names = b"Emulated\0Pioneer\0" + self._row.model.encode() + b"\0" if number == 2 else b""
            self._out.append(encoded(bytes([number]) + names))
            self._synced += 1
        else:
            self._synced = 0
            if number in (0, 1, 2):
                self._out.append(encoded(bytes([0xFF])))

    def _obey(self, number: int, argument: int | bytes | None) -> None:
        value = argument if isinstance(argument, int) else 0
        match number:
            case CommandNumber.CLOSE:
                self._reset()
            case CommandNumber.ENABLE:
                self.motors = value != 0 and not self.stop_button
                self._motion.is_estopped = False
            case CommandNumber.SETO:
                self._origin = self.pose
            case CommandNumber.CONFIG:
                self._out.append(encoded(self._config()))
            case CommandNumber.ENCODER:
                self._streams_encoders = value > 1
                self._out.append(encoded(self._encoder_packet()))
            case _:
                self._set(number, value)

    def _set(self, number: int, value: int) -> None:
        match number:
            case CommandNumber.SONAR:
                self._sonar_on = bool(value & 1)
            case CommandNumber.SONAR_CYCLE:
                self._cycle_of_sonars_s = min(120, max(2, value)) / 1000.0
            case CommandNumber.BUMPSTALL:
                self.bump_stall = value
            case CommandNumber.JOYDRIVE:
                self._joystick_drives = value == 1
            case _:
                self._motion.obey(number, value, self.pose[2], self._origin[2])

    # --- time ----------------------------------------------------------------------------------------

    def step(self) -> None:
        """Let `STEP_S` pass."""
        self._silent_s += STEP_S
        self.volts = max(10.0, self.volts - DRAIN_V_PER_S * STEP_S)
        if self.stop_button:
            self.motors = False
        self._move()
        if self.is_open:
            self._fire()
            self._packet_s += STEP_S
            if self._packet_s >= self._cycle_s - 1e-9:
                self._packet_s = 0.0
                self._out.append(encoded(self._standard()))
                if self._streams_encoders:
                    self._out.append(encoded(self._encoder_packet()))

    @property
    def set_points(self) -> tuple[float, float]:
        """The latched speeds, in mm/s and deg/s, which it resumes once it may."""
        return self._motion.set_points

    @property
    def speed(self) -> float:
        """Its speed as it is, in mm/s."""
        return self._motion.speed

    @property
    def turn(self) -> float:
        """Its turning speed as it is, in deg/s."""
        return self._motion.turn

    @property
    def is_estopped(self) -> bool:
        """Whether it brakes hard, or stands after that, until it is commanded to move."""
        return self._motion.is_estopped

    @property
    def is_timed_out(self) -> bool:
        """Whether the watchdog holds the motors."""
        return bool(self._watchdog_ms) and self._silent_s * 1000.0 > self._watchdog_ms

    def _move(self) -> None:
        drives = self.is_open and self.motors and not self.is_timed_out
        takes_over = self.motors and (self._joystick_drives or not self.is_open)
        self._motion.step(
            self.pose[2],
            drives=drives,
            is_off=not self.motors,
            joystick=self.joystick if takes_over else None,
        )
        if self.is_blocked:
            self._motion.speed = 0.0
        self.pose = moved(self.pose, self.speed, self.turn, STEP_S)
        for i, wheel in enumerate(self._motion.wheels()):
            self._encoders[i] += wheel * STEP_S

    @property
    def is_blocked(self) -> bool:
        """Whether something is in the way, so that the wheels stall."""
        if not self.speed:
            return False
        ahead, bumper = (0.0, 1) if self.speed > 0.0 else (180.0, 2)
        if self.bump_stall & bumper and self._pressed(ahead):
            return True
        return any(self._gap(ahead + side) <= 0.0 for side in range(-80, 81, 20))

    def _gap(self, bearing: float) -> float:
        """Return the way from the hull to what is there, in mm."""
        x, y, heading = self.pose
        return self._around(x, y, heading + bearing) - RADIUS_MM

    def _pressed(self, middle: float) -> int:
        """Return the pressed segments of the bumper whose middle is at this bearing."""
        bearings = [middle + 30.0 * (i - (self._bumpers - 1) / 2.0) for i in range(self._bumpers)]
        nearest = math.inf if self.touched and not middle else TOUCH_MM
        return sum(1 << i for i, bearing in enumerate(bearings) if self._gap(bearing) <= nearest)

    def _fire(self) -> None:
        if not self._sonar_on or not self._row.sonars:
            return
        self._fire_s += STEP_S
        if self._fire_s < self._cycle_of_sonars_s - 1e-9:
            return
        self._fire_s = 0.0
        for first in range(0, len(self._row.sonars), ARRAY):
            number = first + self._next
            if number < len(self._row.sonars):
                self._fired.append((number, round(self._echo(self._row.sonars[number]) / self._row.range)))
        self._next = (self._next + 1) % ARRAY

    def _echo(self, sonar: SonarPose) -> float:
        x, y, heading = self.pose
        ahead, left = math.cos(math.radians(heading)), math.sin(math.radians(heading))
        at = (x + sonar.x * ahead - sonar.y * left, y + sonar.x * left + sonar.y * ahead)
        beam = (-HALF_BEAM_DEG, 0.0, HALF_BEAM_DEG)
        return min(SONAR_MAX_MM, *(self._around(*at, heading + sonar.bearing + side) for side in beam))

    # --- packets -------------------------------------------------------------------------------------

    def _standard(self) -> bytes:
        row = self._row
        from_x, from_y, from_heading = (now - then for now, then in zip(self.pose, self._origin, strict=True))
        angle = math.radians(self._origin[2])
        x = from_x * math.cos(angle) + from_y * math.sin(angle)
        y = from_y * math.cos(angle) - from_x * math.sin(angle)
        half = row.turn_units // 2
        stalled = int(self.is_blocked or (bool(self._motion.ahead) and self.motors and self._touches()))
        left, right = (round(wheel / row.speed) for wheel in self._motion.wheels())
        fired, self._fired = self._fired, []
        return (
            struct.pack(
                "<BHHhhhBHhHBB",
                0x33 if self.speed or self.turn else 0x32,
                int(x // row.distance) & 0x7FFF,
                int(y // row.distance) & 0x7FFF,
                (round(from_heading * row.turn_units / 360.0) + half) % row.turn_units - half,
                left,
                right,
                round(self.volts * 10.0),
                (self._pressed(180.0) << 1 | stalled) | (self._pressed(0.0) << 1 | stalled) << 8,
                0,
                int(self.motors) | int(self._sonar_on) << 1 | int(self.stop_button) << 5,
                0,
                len(fired),
            )
            + b"".join(struct.pack("<BH", *one) for one in fired)
            + struct.pack("<BBBBB", 0, 0, 0, 0, 0)
            + struct.pack("<HBhH", round(self.volts * 10.0), 0, round(self.turn * 10.0), 0)
        )

    def _touches(self) -> bool:
        return bool(self._pressed(0.0 if self._motion.ahead > 0.0 else 180.0))

    def _encoder_packet(self) -> bytes:
        return b"\x90" + b"".join(
            struct.pack("<I", round(count * 128.0) & 0xFFFFFFFF) for count in self._encoders
        )

    def _config(self) -> bytes:
        row, motion = self._row, self._motion
        turns = (motion.turn_acceleration, motion.turn_deceleration)
        names = (b"Pioneer", row.model.encode(), b"SERIAL")
        tops = (row.max_turn, row.max_speed, 300, 2000, 500)
        cycle_ms = round(self._cycle_s * 1000.0)
        settings = struct.pack("<BBBHHBHHH", cycle_ms, 0, 0, 0, 1, 1, 115, 16570, self._watchdog_ms)
        return (
            b"\x20"
            + b"".join(name + b"\0" for name in names)
            + struct.pack("<BHHHHH", 0, *tops)
            + b"Emulated\0"
            + settings
            + bytes(9)
            + struct.pack("<HHHH", motion.max_turn, motion.max_speed, *turns)
            + bytes(6)
            + struct.pack("<HH", motion.acceleration, motion.deceleration)
            + bytes(6)
            + bytes([self._bumpers, self._bumpers, 0, 40, 1, 0])
        )
