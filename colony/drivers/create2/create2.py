"""The dialect of the Create 2, and its drivers, for the bodies of robots.

The robot has no watchdog: a speed holds until the next one, so that the guard alone stops it when no frame is
decided. It drives in safe mode, in which it stops by itself and falls back to passive mode when a wheel
hangs, a cliff is ahead or its charger is plugged in. That is a fault: the driver reports it, and does not
enter safe mode again until its server is started again.

Source: iRobot Create 2 Open Interface specification (2018), and what happened to others (docs/create2.md).
"""

from __future__ import annotations

import math
from collections import deque

from colony.drivers.create2.codec import (
    FORCE_FIELD,
    GREEN_BUOY,
    MAX_WHEEL,
    RED_BUOY,
    STREAM,
    Create2State,
    OiMode,
    Opcode,
    StreamFrame,
    beam_heard,
    command,
    decoder,
    drive_direct,
    implausible,
    state_of,
    stream,
)
from colony.drivers.dialect import (
    Ask,
    Decoder,
    Dialect,
    ImplausibleError,
    Opening,
    OpeningError,
    Readings,
    Send,
)
from colony.drivers.odometry import OdometryPose, Registers, along_arc
from colony.drivers.serial_base import SerialBase, SerialFields
from colony.ir.types import Value
from colony.runtime.servers.drivers import BaseState

MM_PER_COUNT = math.pi * 72.0 / 508.8
BASE_MM = 235.0

FRAME_NS = 22_000_000
"""Period of the stream, and transmission of a frame at 115200 baud: so old its readings are at most."""

WINDOW_NS = 100_000_000
"""Time over which speeds are measured: in one frame a wheel counts at most 17 steps."""

STARTS = bytes([Opcode.START]) * 6
"""START until one is no data of a command that was cut off; those behind it change nothing."""

SETTLE_S = 0.6
"""Pause before the opening, in which the stop of a new guard is repeated."""

MODE_S = 0.05
"""Pause after a change of mode; 20 ms are demanded."""

ATTEMPTS = 4

BEAMS = {"dock_red": RED_BUOY, "dock_green": GREEN_BUOY, "dock_field": FORCE_FIELD}
"""The beams of a dock by the names of their fields."""

MAX_SIGNAL, LIGHT_DECAY_MM, LIGHT_REACH_MM = 4_095, 80.0, 300.0
"""The strongest echo of the light bumper, how its strength is taken to fall, and how far it is looked at."""


class Create2(Dialect[StreamFrame]):
    """The dialect. Mutable: has the pose by dead reckoning, and why the robot may not drive any more.

    Fields: battery (percent), volts, charging, docked, wheel_drop, stalled, mode; bumper (left, right), cliff
    (left, front left, front right, right), range (of the light bumper, from left to right, in mm); dock_red,
    dock_green, dock_field (whether the receivers to the left, all around and to the right hear that beam).

    Args:
        mode_offset: what the firmware adds to the mode that it reports: 0 or 1.
    """

    baud = 115_200
    delay_ns = FRAME_NS
    stop_bytes = drive_direct(0, 0) * 2  # the first may be taken for the data of a command that was cut off
    goodbye = command(Opcode.STOP)
    max_speed = 1.2 * MAX_WHEEL
    max_turn = math.degrees(2.4 * MAX_WHEEL / BASE_MM)

    def __init__(self, mode_offset: int = 0) -> None:
        if mode_offset not in (0, 1):
            raise ValueError(f"mode_offset is {mode_offset}; it is 0 or 1")
        self._passive, self._safe = OiMode.PASSIVE + mode_offset, OiMode.SAFE + mode_offset
        self._registers = Registers(16, 16, max_rate=1.2 * MAX_WHEEL / MM_PER_COUNT)
        self._pose = OdometryPose()
        self._travel = (0.0, 0.0)
        self._past: deque[tuple[int, float, float]] = deque()
        self._drives = False
        self._fault = ""

    def decoder(self) -> Decoder[StreamFrame]:
        """Return a decoder of the frames of the stream."""
        return decoder()

    def restart(self) -> None:
        """Count from the next values of the encoders on; keep the pose, and the fault."""
        self._registers.restart()
        self._past.clear()
        self._drives = False

    def opening(self) -> Opening[StreamFrame]:
        """Return the opening: start, stream, safe mode once; refused after a fault."""
        if self._fault:
            raise OpeningError(self._fault)
        yield Send(b"", SETTLE_S)
        for _ in range(ATTEMPTS):
            yield Send(STARTS, MODE_S)
            if (yield Ask(stream(STREAM), _any)) is not None:
                break
        else:
            raise OpeningError(
                "no Create answers: is it switched on and awake, its baud rate 115200? Press CLEAN to wake it"
            )
        yield Ask(b"", self._is_passive)  # frames of before arrive late where the computer is slow
        yield Send(command(Opcode.SAFE), MODE_S)
        if (yield Ask(b"", self._is_safe)) is None:
            frame = yield Ask(b"", _any)
            if frame is None:
                raise OpeningError("the stream of the Create has ended")
            raise OpeningError(f"the Create does not enter safe mode: {_reason(state_of(frame.values()))}")
        self._drives = True

    def read(self, packet: StreamFrame, t_ns: int) -> Readings:
        """Return what a frame measured.

        Raises:
            ImplausibleError: a reading is outside the device's physics.
            OpeningError: the robot has left safe mode.
        """
        values = packet.values()
        if (text := implausible(values)) is not None:
            raise ImplausibleError(text)
        state = state_of(values)
        base = self._base(state, t_ns)
        if self._drives and state.mode != self._safe:
            self._fault = f"the Create left safe mode ({_reason(state)}): see to it, then start RServer again"
            raise OpeningError(self._fault)
        return Readings(base=base, fields=_fields(state))

    def _is_passive(self, frame: StreamFrame) -> bool:
        """Return True for a frame from after START; there is none where `mode_offset` is wrong."""
        return state_of(frame.values()).mode == self._passive

    def _is_safe(self, frame: StreamFrame) -> bool:
        return state_of(frame.values()).mode == self._safe

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> bytes:
        """Return the speeds of both wheels, slowed down together where one would be too fast."""
        if sideways:
            raise ValueError("a Create does not drive sideways")
        half = math.radians(turn) * BASE_MM / 2.0
        part = min(1.0, MAX_WHEEL / max(abs(velocity) + abs(half), 1.0))
        return drive_direct(round((velocity + half) * part), round((velocity - half) * part))

    def _base(self, state: Create2State, t_ns: int) -> BaseState:
        steps, _ = self._registers.step((state.encoder_left, state.encoder_right), t_ns)
        left, right = (count * MM_PER_COUNT for count in steps)
        self._pose = along_arc(self._pose, (left + right) / 2.0, math.degrees((right - left) / BASE_MM))
        self._travel = (self._travel[0] + left, self._travel[1] + right)
        left_speed, right_speed = self._speeds(t_ns)
        return BaseState(
            t_ns=t_ns,
            x=self._pose.x,
            y=self._pose.y,
            heading=self._pose.heading,
            front_bumper=state.bump_left or state.bump_right,
            rear_bumper=False,
            speed=(left_speed + right_speed) / 2.0,
            turn_rate=math.degrees((right_speed - left_speed) / BASE_MM),
            wheel_speed=(abs(left_speed) + abs(right_speed)) / 2.0,
        )

    def _speeds(self, t_ns: int) -> tuple[float, float]:
        """Return the speeds over the window; times of arrival jitter, wheels are not faster than they can."""
        self._past.append((t_ns, *self._travel))
        while len(self._past) > 2 and self._past[1][0] <= t_ns - WINDOW_NS:
            self._past.popleft()
        then_ns, *then = self._past[0]
        elapsed_s = (t_ns - then_ns) / 1e9
        if elapsed_s < 0.03:
            return 0.0, 0.0
        left, right = (
            max(-MAX_WHEEL, min(MAX_WHEEL, (now - was) / elapsed_s))
            for now, was in zip(self._travel, then, strict=True)
        )
        return left, right


def _any(frame: StreamFrame) -> bool:
    return True


def _reason(state: Create2State) -> str:
    """Return why the robot is not in safe mode, as far as it says so."""
    if state.drop_left or state.drop_right:
        return "a wheel hangs"
    if any(state.cliffs):
        return "a cliff"
    if state.plugged or state.on_dock:
        return "its charger is plugged in, or it is on the dock"
    return f"mode {state.mode}: a button, or a damaged command"


def _fields(state: Create2State) -> dict[str, Value]:
    level = 100.0 * state.charge / state.capacity if state.capacity else 0.0
    return {
        "battery": min(100.0, level),
        "volts": state.voltage,
        "charging": state.charging,
        "docked": state.on_dock,
        "bumper": (state.bump_left, state.bump_right),
        "wheel_drop": state.drop_left or state.drop_right,
        "stalled": state.overcurrent_left or state.overcurrent_right,
        "mode": float(state.mode),
        "cliff": state.cliffs,
        "range": tuple(map(_range, state.light_signals)),
        **{name: tuple(beam_heard(one, beam) for one in state.infrared) for name, beam in BEAMS.items()},
    }


def _range(signal: int) -> float:
    """Return a rough range in mm of an echo; infinity for none. Dark things seem farther than they are."""
    mm = LIGHT_DECAY_MM * math.log(MAX_SIGNAL / max(signal, 1))
    return mm if mm < LIGHT_REACH_MM else math.inf


def base(port: str, *, frame_ns: int, baud: int = 0, mode_offset: int = 0) -> SerialBase[StreamFrame]:
    """Return the driver of `RServer`."""
    return SerialBase(Create2(mode_offset), port, baud=baud, frame_ns=frame_ns)


def fields(port: str, *, baud: int = 0, **names: str) -> SerialFields[StreamFrame]:
    """Return the driver of another server; `names` are the dialect's names of its fields."""
    return SerialFields(Create2(), port, names, baud=baud)
