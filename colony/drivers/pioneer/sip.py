"""The packets that a Pioneer sends, from the data of a frame to frozen values in the units of the robot.

Server information packets (SIP): the standard one each cycle, encoders and the configuration when asked for,
and the answers of the handshake. Fields that only newer firmware sends are None where the packet ends.

Sources: Pioneer 2 and Pioneer 3 operations manuals; the order of the configuration's fields as ARIA reads it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

STOPPED, MOVING = 0x32, 0x33

_HEAD = struct.Struct("<HHhhhBHhHBB")


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardSip:
    """The standard packet.

    Attributes:
        moving: what its type says; some firmware and simulators always say False.
        x, y, heading: registers of dead reckoning, which wrap around.
        left_speed, right_speed: speeds of the wheels.
        battery: tenths of a volt.
        left_stalled, right_stalled: whether a wheel turns less than it is driven.
        front_bumpers, rear_bumpers: pressed segments, the first in bit 0. Robots without bumpers report any.
        control: set point of the heading servo.
        flags: bit 0: motors on; bits 1 to 4: sonar arrays on; bit 5: stop button. Old P2OS has a pulse width.
        compass: units of 2 degrees.
        sonars: new readings: number of the disc, range.
        analog, digital_in, digital_out: user ports.
        battery_fine: tenths of a volt with more range; charge: state of the charger; turn_rate: tenths of
            a degree per second, counterclockwise; faults: fault flags. None if the packet ends before.
    """

    moving: bool
    x: int
    y: int
    heading: int
    left_speed: int
    right_speed: int
    battery: int
    left_stalled: bool
    right_stalled: bool
    front_bumpers: int
    rear_bumpers: int
    control: int
    flags: int
    compass: int
    sonars: tuple[tuple[int, int], ...]
    analog: int | None = None
    digital_in: int | None = None
    digital_out: int | None = None
    battery_fine: int | None = None
    charge: int | None = None
    turn_rate: int | None = None
    faults: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderSip:
    """The counts of the wheels' encoders, unsigned, of 32 bits."""

    left: int
    right: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SipIdentity:
    """The identity of a robot: the answer to SYNC2."""

    name: str
    type: str
    model: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigSip:
    """The configuration of a robot.

    Attributes:
        identity: its name, class and subclass; serial: its serial number.
        max_turn, max_speed, max_turn_acceleration, max_acceleration: limits that cannot be changed, in deg/s,
            mm/s, deg/s^2 and mm/s^2.
        cycle_ms: period of standard packets, 0 if it is not given.
        low_battery: tenths of a volt at which it beeps.
        watchdog_ms: time without a packet from the host after which the motors stop; 0 if never.
        front_bumpers, rear_bumpers: number of segments.
    """

    identity: SipIdentity
    serial: str
    max_turn: int
    max_speed: int
    max_turn_acceleration: int
    max_acceleration: int
    cycle_ms: int
    low_battery: int
    watchdog_ms: int
    front_bumpers: int
    rear_bumpers: int


Sip = StandardSip | EncoderSip | ConfigSip | SipIdentity


def read_sip(data: bytes) -> Sip | None:
    """Return what the data of a frame says; None for another type, or a packet that ends too early."""
    try:
        match data[0]:
            case 0x32 | 0x33:
                return _standard(data)
            case 0x90:
                return EncoderSip(left=_u32(data, 1), right=_u32(data, 5))
            case 0x20:
                return _config(data)
            case 2:
                name, type_, model = _Fields(data).texts(3)
                return SipIdentity(name=name, type=type_, model=model)
            case _:
                return None
    except (struct.error, ValueError, IndexError):
        return None


def may_drive(data: bytes) -> bool:
    """Return True if a packet shows that the motors are on, or is of firmware that does not say so."""
    sip = read_sip(data)
    return isinstance(sip, StandardSip) and (sip.battery_fine is None or bool(sip.flags & 1))


def mask_of(segments: int) -> int:
    """Return the bits of so many segments of a bumper.

    Raises:
        ValueError: no bumper has as many.
    """
    if not 0 <= segments <= 7:
        raise ValueError(f"{segments} segments of a bumper; up to 7 are possible")
    return (1 << segments) - 1


def _u32(data: bytes, at: int) -> int:
    value: int = struct.unpack_from("<I", data, at)[0]
    return value


def _standard(data: bytes) -> StandardSip:
    x, y, heading, left, right, battery, bumps, control, flags, compass, count = _HEAD.unpack_from(data, 1)
    at = 1 + _HEAD.size
    sonars = tuple(struct.unpack_from("<BH", data, at + 3 * i) for i in range(count))
    rest = _Fields(data, at + 3 * count + 2)  # behind the state of the gripper, and the analog port or timer
    return StandardSip(
        moving=data[0] == MOVING,
        x=x,
        y=y,
        heading=heading,
        left_speed=left,
        right_speed=right,
        battery=battery,
        left_stalled=bool(bumps & 1),
        right_stalled=bool(bumps >> 8 & 1),
        front_bumpers=bumps >> 9,
        rear_bumpers=bumps >> 1 & 0x7F,
        control=control,
        flags=flags,
        compass=compass,
        sonars=sonars,
        analog=rest.number("B"),
        digital_in=rest.number("B"),
        digital_out=rest.number("B"),
        battery_fine=rest.number("H"),
        charge=rest.number("B"),
        turn_rate=rest.number("h"),
        faults=rest.number("H"),
    )


def _config(data: bytes) -> ConfigSip:
    fields = _Fields(data)
    type_, model, serial = fields.texts(3)
    _, max_turn, max_speed, max_turn_acceleration, max_acceleration, _ = fields.numbers("BHHHHH")
    (name,) = fields.texts(1)
    cycle, _, _, _, _, _, low_battery, _, watchdog = fields.numbers("BBBHHBHHH")
    fields.numbers("BHHHH" + "HHHHHHH" + "HHHHH")  # stall, joystick, set maxima and gains
    front, rear = fields.numbers("BB")
    return ConfigSip(
        identity=SipIdentity(name=name, type=type_, model=model),
        serial=serial,
        max_turn=max_turn,
        max_speed=max_speed,
        max_turn_acceleration=max_turn_acceleration,
        max_acceleration=max_acceleration,
        cycle_ms=cycle,
        low_battery=low_battery,
        watchdog_ms=watchdog,
        front_bumpers=front,
        rear_bumpers=rear,
    )


class _Fields:
    """The fields of a packet, read in order. Mutable: the place of the next one."""

    def __init__(self, data: bytes, at: int = 1) -> None:
        self._data = data
        self._at = at

    def number(self, kind: str) -> int | None:
        """Return the next number; None, as for all behind it, if the packet ends before it."""
        if self._at + struct.calcsize(kind) > len(self._data):
            self._at = len(self._data)
            return None
        return self.numbers(kind)[0]

    def numbers(self, kinds: str) -> tuple[int, ...]:
        """Return the next numbers, each of a kind of `struct`."""
        values = struct.unpack_from(f"<{kinds}", self._data, self._at)
        self._at += struct.calcsize(f"<{kinds}")
        return values

    def texts(self, count: int) -> list[str]:
        """Return the next texts, each of which ends with a zero."""
        found = []
        for _ in range(count):
            end = self._data.index(0, self._at)
            found.append(self._data[self._at : end].decode("ascii", "replace"))
            self._at = end + 1
        return found
