"""What runs in an emulated Create 2: modes, wheels, bumpers, cliffs, battery and the stream. Pure.

Bytes go in and come out; time passes in steps of 5 ms. Functions of its `EmulatedWorld` say what surrounds
the robot. It has no watchdog: a speed holds until another one, a safety event, or another mode. Its pose is
in mm, x ahead at the start, y to the left, and degrees counterclockwise.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

from colony.drivers.create2.codec import (
    DOCK,
    FORCE_FIELD,
    GREEN_BUOY,
    GROUPS,
    MAX_WHEEL,
    PACKETS,
    RED_BUOY,
    CommandReader,
    OiMode,
    Opcode,
    StreamFrame,
    data_of,
    encoded,
)
from colony.drivers.emulator import STEP_S, Pose, Surroundings, moved, open_field

STREAM_S = 0.015
SLEEP_S = 300.0
COUNTS_PER_MM = 508.8 / (math.pi * 72.0)
BASE_MM = 235.0
RADIUS_MM = 174.0
ACCELERATION = 1_500.0
LIGHT_REACH_MM = 80.0
NEAR_SIGNAL = 400
CLIFF_BEARINGS = (60.0, 15.0, -15.0, -60.0)
LIGHT_BEARINGS = (65.0, 38.0, 13.0, -13.0, -38.0, -65.0)
FULL_MAH = 2_600.0
BEAM_REACH_MM, FIELD_REACH_MM = 2_500.0, 600.0
BUOYS = ((RED_BUOY, -30.0, 5.0), (GREEN_BUOY, -5.0, 30.0))
"""The beams of a dock, and between which bearings from its axis they are heard; guessed."""

RECEIVERS = (("left", -10.0, 60.0), ("omni", -180.0, 180.0), ("right", -60.0, 10.0))
"""The receivers, and between which bearings they hear; guessed but for the one that hears all around."""


def _floor(x: float, y: float) -> bool:
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedWorld:
    """What is around the robot.

    Attributes:
        range: the range in mm from a point (mm) into a direction (degrees); infinite for nothing.
        floor: whether there is floor at a point.
        dock: the pose of a robot that charges at it; None for no dock.
    """

    range: Surroundings = open_field
    floor: Callable[[float, float], bool] = _floor
    dock: Pose | None = None


class Create2Firmware:
    """The robot. Mutable.

    Attributes:
        pose: x, y and heading, as they are.
        wheels: speeds of the left and the right wheel in mm/s.
        mode: its mode.
        drops: whether the left and the right wheel hang.
        plugged: whether the charger's cable is plugged in.
        touched: whether something presses its bumper, besides what is around.
    """

    def __init__(self, world: EmulatedWorld | None = None) -> None:
        self._world = world or EmulatedWorld()
        self._reader = CommandReader()
        self._out: list[bytes] = []
        self.pose = (0.0, 0.0, 0.0)
        self.wheels = (0.0, 0.0)
        self.mode = OiMode.OFF
        self.drops = (False, False)
        self.plugged = self.touched = False
        self._wanted = (0, 0)
        self._travel = [0.0, 0.0]
        self._charge = FULL_MAH
        self._ids: tuple[int, ...] = ()
        self._streams = False
        self._stream_s = self._idle_s = 0.0

    # --- the line ------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Take bytes from the host."""
        for opcode, rest in self._reader.feed(data):
            self._idle_s = 0.0
            if opcode == Opcode.START:
                self._enter(OiMode.PASSIVE)
            elif self.mode != OiMode.OFF:
                self._obey(opcode, rest)

    def sent(self) -> list[bytes]:
        """Return what is to be sent, oldest first, and forget it."""
        out, self._out = self._out, []
        return out

    def _enter(self, mode: OiMode) -> None:
        self.mode = mode
        if mode in (OiMode.OFF, OiMode.PASSIVE):
            self._wanted = (0, 0)
        if mode == OiMode.OFF:
            self._streams = False

    def _obey(self, opcode: int, data: bytes) -> None:
        drives = self.mode in (OiMode.SAFE, OiMode.FULL)
        match opcode:
            case Opcode.SAFE | Opcode.CONTROL:
                self._enter(OiMode.SAFE)
            case Opcode.FULL:
                self._enter(OiMode.FULL)
            case Opcode.POWER | Opcode.DOCK | Opcode.SPOT | Opcode.CLEAN | Opcode.MAX:
                self._enter(OiMode.PASSIVE)
            case Opcode.STOP | Opcode.RESET:
                self._enter(OiMode.OFF)
            case Opcode.DRIVE_DIRECT if drives:
                right, left = struct.unpack(">hh", data)
                self._wanted = (_bounded(left), _bounded(right))
            case Opcode.DRIVE if drives:
                self._wanted = _wheels_of(*struct.unpack(">hh", data))
            case Opcode.DRIVE_PWM if drives:
                right, left = struct.unpack(">hh", data)
                self._wanted = (_of_duty(left), _of_duty(right))
            case Opcode.SENSORS:
                self._answer(data)
            case Opcode.QUERY_LIST:
                self._answer(data[1:])
            case Opcode.STREAM:
                self._ids = tuple(number for number in data[1:] if number in PACKETS)
                self._streams = bool(self._ids)
            case Opcode.PAUSE_RESUME:
                self._streams = bool(data[0]) and bool(self._ids)
            case _:
                pass

    def _answer(self, ids: bytes) -> None:
        self._out.append(
            data_of(bytes(number for number in ids if number in PACKETS or number in GROUPS), self._values())
        )

    @property
    def set_points(self) -> tuple[int, int]:
        """The speeds of the left and the right wheel that it was commanded, in mm/s."""
        return self._wanted

    # --- time ----------------------------------------------------------------------------------------

    def step(self) -> None:
        """Let `STEP_S` pass."""
        self._idle_s += STEP_S
        self._move()
        is_charging = self.plugged or self._is_docked()
        self._charge = min(FULL_MAH, max(0.0, self._charge + (0.4 if is_charging else -0.1) * STEP_S))
        if self.mode == OiMode.SAFE and self._is_unsafe():
            self._enter(OiMode.PASSIVE)
        if self.mode == OiMode.PASSIVE and self._idle_s > SLEEP_S and not is_charging:
            self._enter(OiMode.OFF)
        self._stream_s += STEP_S
        if self._stream_s >= STREAM_S - 1e-9:
            self._stream_s = 0.0
            if self._streams:
                self._out.append(encoded(StreamFrame(self._ids, data_of(self._ids, self._values()))))

    def _is_unsafe(self) -> bool:
        """Whether a wheel hangs, the charger is plugged in, or a cliff is ahead of the motion."""
        left, right = self._wanted
        is_tight = left * right <= 0 or abs(left + right) < abs(left - right)
        runs_off = any(self._cliffs()) and (left + right > 0 or (left + right < 0 and is_tight))
        return any(self.drops) or self.plugged or runs_off

    def _move(self) -> None:
        most = ACCELERATION * STEP_S
        left, right = (
            now + max(-most, min(most, wanted - now))
            for now, wanted in zip(self.wheels, self._wanted, strict=True)
        )
        if self.is_stalled:
            half = (left - right) / 2.0  # a circle against a wall still turns
            left, right = half, -half
        self.wheels = (left, right)
        speed, turn = (left + right) / 2.0, math.degrees((right - left) / BASE_MM)
        self.pose = moved(self.pose, speed, turn, STEP_S)
        self._travel[0] += left * STEP_S
        self._travel[1] += right * STEP_S

    @property
    def is_stalled(self) -> bool:
        """Whether something is in the way of where the wheels are to go."""
        speed = sum(self._wanted)
        ahead = 0.0 if speed > 0 else 180.0
        return bool(speed) and any(self._gap(ahead + side) <= 0.0 for side in range(-75, 76, 15))

    def _gap(self, bearing: float) -> float:
        """Return the way from the hull to what is there, in mm."""
        x, y, heading = self.pose
        return self._world.range(x, y, heading + bearing) - RADIUS_MM

    def _cliffs(self) -> list[bool]:
        x, y, heading = self.pose
        angles = [math.radians(heading + bearing) for bearing in CLIFF_BEARINGS]
        reach = RADIUS_MM - 14.0
        return [not self._world.floor(x + reach * math.cos(a), y + reach * math.sin(a)) for a in angles]

    def _is_docked(self) -> bool:
        dock = self._world.dock
        return dock is not None and math.dist(self.pose[:2], dock[:2]) < 50.0 and not any(self._wanted)

    def _heard(self) -> dict[str, int]:
        """Return the character that each receiver hears of the dock, 0 for none."""
        if self._world.dock is None:
            return {}
        dock_x, dock_y, facing = self._world.dock
        angle = math.radians(facing)
        dock_x, dock_y = dock_x + RADIUS_MM * math.cos(angle), dock_y + RADIUS_MM * math.sin(angle)
        x, y, heading = self.pose
        way, seen_at = math.hypot(dock_x - x, dock_y - y), math.degrees(math.atan2(dock_y - y, dock_x - x))
        bearing = math.remainder(seen_at - heading, 360.0)
        aside = math.remainder(seen_at - facing, 360.0)
        beams = sum(beam for beam, low, high in BUOYS if way < BEAM_REACH_MM and low <= aside <= high)
        beams += FORCE_FIELD if way < FIELD_REACH_MM else 0
        hears = {name for name, low, high in RECEIVERS if beams and low <= bearing <= high}
        return {f"infrared_{name}": DOCK | beams for name in hears}

    def _values(self) -> dict[str, int]:
        left_bump = self.touched or any(self._gap(side) <= 3.0 for side in range(0, 91, 15))
        right_bump = self.touched or any(self._gap(-side) <= 3.0 for side in range(0, 91, 15))
        drop_left, drop_right = self.drops
        lights = [
            min(4095, round(4095 * math.exp(-max(0.0, gap) / LIGHT_REACH_MM)))
            for gap in map(self._gap, LIGHT_BEARINGS)
        ]
        names = ("left", "front_left", "center_left", "center_right", "front_right", "right")
        cliffs = zip(("left", "front_left", "front_right", "right"), self._cliffs(), strict=True)
        docked = self._is_docked()
        wanted_left, wanted_right = self._wanted
        return {
            "bumps_and_drops": right_bump | left_bump << 1 | drop_right << 2 | drop_left << 3,
            "overcurrents": 24 if self.is_stalled else 0,
            "charging_state": 2 if docked or self.plugged else 0,
            "voltage": 14_000 + round(self._charge),
            "current": 1_000 if docked or self.plugged else -250,
            "temperature": 25,
            "charge": round(self._charge),
            "capacity": round(FULL_MAH),
            "charging_sources": int(self.plugged) | docked << 1,
            "mode": self.mode,
            "stream_packets": len(self._ids),
            "requested_right": wanted_right,
            "requested_left": wanted_left,
            "encoder_left": math.floor(self._travel[0] * COUNTS_PER_MM) & 0xFFFF,
            "encoder_right": math.floor(self._travel[1] * COUNTS_PER_MM) & 0xFFFF,
            **self._heard(),
            "light_bumper": sum((light > NEAR_SIGNAL) << i for i, light in enumerate(lights)),
            **{f"cliff_{name}": int(is_cliff) for name, is_cliff in cliffs},
            **{f"light_{name}": light for name, light in zip(names, lights, strict=True)},
        }


def _bounded(speed: int) -> int:
    return max(-MAX_WHEEL, min(MAX_WHEEL, speed))


def _of_duty(duty: int) -> int:
    """Return the speed of a wheel at a duty cycle of -255 to 255, without load."""
    return _bounded(round(duty * MAX_WHEEL / 255.0))


def _wheels_of(velocity: int, radius: int) -> tuple[int, int]:
    """Return the speeds of the left and the right wheel of the command DRIVE."""
    if radius in (0x7FFF, -0x8000, 0):
        return velocity, velocity
    if abs(radius) == 1:
        return -radius * velocity, radius * velocity
    part = BASE_MM / 2.0 / radius
    return _bounded(round(velocity * (1.0 - part))), _bounded(round(velocity * (1.0 + part)))
