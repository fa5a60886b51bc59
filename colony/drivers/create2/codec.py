"""Frames of the Open Interface's stream, and its commands. Pure: bytes to frames, and commands to bytes.

A frame is `19 N id data id data ... sum`. The sum of all its bytes, the 19 among them, is 0 modulo 256; the
example of the Create 1 manual leaves the 19 out (182 for 163). 19 occurs in data as well, so that a frame
counts only if it has exactly the packets that were asked for, in their order.

Commands have neither a frame nor a checksum: an opcode and data, big endian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from colony.drivers.dialect import Need, SlidingDecoder

# --- sensors ------------------------------------------------------------------------------------------
#
# The sensor packets of the Open Interface as a table, and what they mean. Pure.
#
# All integers are big endian. Sides are those of the specification: bit 0 of packet 7 is the *right* bumper;
# in packets 41 to 44 the encoders are left then right, the requested speeds right then left. pycreate2 0.8.0
# swaps the sides of packet 7, and gives packets 32 and 33 three bytes each, which have one and two.
#
# Source: iRobot Create 2 Open Interface specification (2018).


@dataclass(frozen=True, slots=True)
class Packet:
    """A sensor packet: its size in bytes, whether it is signed, its unit, and its name."""

    id: int
    size: int
    signed: bool
    unit: str
    name: str


class OiMode(IntEnum):
    """The modes of packet 35; some firmware reports greater numbers."""

    OFF = 0
    PASSIVE = 1
    SAFE = 2
    FULL = 3


def _table(*rows: tuple[int, str, str, str]) -> dict[int, Packet]:
    """Return the table of rows of an id, a kind (u or i, and bytes), a unit and a name."""
    return {
        number: Packet(number, int(kind[1]), kind[0] == "i", unit, name) for number, kind, unit, name in rows
    }


PACKETS = _table(
    (7, "u1", "bits", "bumps_and_drops"),
    (8, "u1", "bool", "wall"),
    (9, "u1", "bool", "cliff_left"),
    (10, "u1", "bool", "cliff_front_left"),
    (11, "u1", "bool", "cliff_front_right"),
    (12, "u1", "bool", "cliff_right"),
    (13, "u1", "bool", "virtual_wall"),
    (14, "u1", "bits", "overcurrents"),
    (15, "u1", "", "dirt"),
    (16, "u1", "", "unused_16"),
    (17, "u1", "code", "infrared_omni"),
    (18, "u1", "bits", "buttons"),
    (19, "i2", "mm", "distance"),
    (20, "i2", "deg", "angle"),
    (21, "u1", "code", "charging_state"),
    (22, "u2", "mV", "voltage"),
    (23, "i2", "mA", "current"),
    (24, "i1", "degC", "temperature"),
    (25, "u2", "mAh", "charge"),
    (26, "u2", "mAh", "capacity"),
    (27, "u2", "", "wall_signal"),
    (28, "u2", "", "cliff_left_signal"),
    (29, "u2", "", "cliff_front_left_signal"),
    (30, "u2", "", "cliff_front_right_signal"),
    (31, "u2", "", "cliff_right_signal"),
    (32, "u1", "", "unused_32"),
    (33, "u2", "", "unused_33"),
    (34, "u1", "bits", "charging_sources"),
    (35, "u1", "code", "mode"),
    (36, "u1", "", "song"),
    (37, "u1", "bool", "song_playing"),
    (38, "u1", "", "stream_packets"),
    (39, "i2", "mm/s", "requested_velocity"),
    (40, "i2", "mm", "requested_radius"),
    (41, "i2", "mm/s", "requested_right"),
    (42, "i2", "mm/s", "requested_left"),
    (43, "u2", "counts", "encoder_left"),
    (44, "u2", "counts", "encoder_right"),
    (45, "u1", "bits", "light_bumper"),
    (46, "u2", "", "light_left"),
    (47, "u2", "", "light_front_left"),
    (48, "u2", "", "light_center_left"),
    (49, "u2", "", "light_center_right"),
    (50, "u2", "", "light_front_right"),
    (51, "u2", "", "light_right"),
    (52, "u1", "code", "infrared_left"),
    (53, "u1", "code", "infrared_right"),
    (54, "i2", "mA", "current_left"),
    (55, "i2", "mA", "current_right"),
    (56, "i2", "mA", "current_main_brush"),
    (57, "i2", "mA", "current_side_brush"),
    (58, "u1", "bits", "stasis"),
)

GROUPS = {
    0: range(7, 27),
    1: range(7, 17),
    2: range(17, 21),
    3: range(21, 27),
    4: range(27, 35),
    5: range(35, 43),
    6: range(7, 43),
    100: range(7, 59),
    101: range(43, 59),
    106: range(46, 52),
    107: range(54, 59),
}

STREAM = (7, *range(9, 13), 14, 17, *range(21, 24), 25, 26, 34, 35, *range(41, 54), 58)
"""The packets of the driver's stream: what its servers read, and no more than 15 ms carry."""

BOUNDS = {
    "bumps_and_drops": (0, 15),
    "cliff_left": (0, 1),
    "cliff_front_left": (0, 1),
    "cliff_front_right": (0, 1),
    "cliff_right": (0, 1),
    "overcurrents": (0, 31),
    "charging_state": (0, 5),
    "voltage": (5_000, 22_000),
    "current": (-8_000, 4_000),
    "charge": (0, 65_535),  # some firmware lets it fall below 0, and so wraps
    "capacity": (0, 10_000),
    "charging_sources": (0, 3),
    "mode": (0, 4),  # some firmware adds 1
    "requested_right": (-500, 500),
    "requested_left": (-500, 500),
    "light_bumper": (0, 63),
    "light_left": (0, 4_095),
    "light_front_left": (0, 4_095),
    "light_center_left": (0, 4_095),
    "light_center_right": (0, 4_095),
    "light_front_right": (0, 4_095),
    "light_right": (0, 4_095),
    "stasis": (0, 3),
}
"""Bounds of the device's physics, because an 8-bit sum lets damaged frames through."""


def expanded(ids: bytes | tuple[int, ...]) -> tuple[int, ...]:
    """Return the single packets of ids, of which some may be groups.

    Raises:
        KeyError: there is no such packet.
    """
    return tuple(one for number in ids for one in GROUPS.get(number, (number,)))


def size_of(number: int) -> int:
    """Return the size of a packet or a group in bytes.

    Raises:
        KeyError: there is no such packet.

    Example:
        >>> size_of(100), size_of(6), size_of(33)
        (80, 52, 2)
    """
    return sum(PACKETS[one].size for one in expanded((number,)))


def values_of(ids: bytes | tuple[int, ...], data: bytes) -> dict[str, int]:
    """Return the values of packets by name, from their unframed data.

    Raises:
        KeyError: there is no such packet.
        ValueError: the data has another size.
    """
    found, at = dict[str, int](), 0
    for number in expanded(ids):
        packet = PACKETS[number]
        found[packet.name] = int.from_bytes(data[at : at + packet.size], "big", signed=packet.signed)
        at += packet.size
    if at != len(data):
        raise ValueError(f"packets {list(ids)} have {at} bytes; found {len(data)}")
    return found


def data_of(ids: bytes | tuple[int, ...], values: dict[str, int]) -> bytes:
    """Return the unframed data of packets; what has no value is 0."""
    packets = [PACKETS[number] for number in expanded(ids)]
    return b"".join(
        values.get(packet.name, 0).to_bytes(packet.size, "big", signed=packet.signed) for packet in packets
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Create2State:
    """What the robot measures, by sides as the specification has them.

    Attributes:
        bump_left, bump_right, drop_left, drop_right: bumpers, and wheels that hang.
        cliffs: left, front left, front right, right.
        light_near, light_signals: the light bumper from left to right, and how strong each echo is.
        overcurrent_left, overcurrent_right: wheels that are held: there is no other stall bit.
        charging, plugged, on_dock: it charges; the charger of a cable, of the dock.
        mode: packet 35 as it is.
        voltage, current, charge, capacity: in V, A, and mAh.
        encoder_left, encoder_right: counts, which wrap at 16 bits.
        infrared: characters that the receivers hear, from left to right; 0 for none. That of the middle one
            hears all around.
        stasis_off: the stasis sensor is disabled, which most often means dirty.
    """

    bump_left: bool
    bump_right: bool
    drop_left: bool
    drop_right: bool
    cliffs: tuple[bool, ...]
    light_near: tuple[bool, ...]
    light_signals: tuple[int, ...]
    overcurrent_left: bool
    overcurrent_right: bool
    charging: bool
    plugged: bool
    on_dock: bool
    mode: int
    voltage: float
    current: float
    charge: int
    capacity: int
    encoder_left: int
    encoder_right: int
    infrared: tuple[int, ...]
    stasis_off: bool


DOCK, FORCE_FIELD, GREEN_BUOY, RED_BUOY = 0xA0, 1, 4, 8
"""The characters of a dock: `DOCK`, with a bit for each of its beams that is heard."""

SIDES = ("left", "front_left", "front_right", "right")
LIGHTS = ("left", "front_left", "center_left", "center_right", "front_right", "right")


def beam_heard(character: int, beam: int) -> bool:
    """Return whether a character is that of a dock whose `beam` is among those that are heard.

    Example:
        >>> beam_heard(164, GREEN_BUOY), beam_heard(164, RED_BUOY), beam_heard(136, RED_BUOY)
        (True, False, False)
    """
    return character & ~(FORCE_FIELD | GREEN_BUOY | RED_BUOY) == DOCK and bool(character & beam)


def implausible(values: dict[str, int]) -> str | None:
    """Return which value is outside the device's physics; None if there is none."""
    for name, value in values.items():
        low, high = BOUNDS.get(name, (value, value))
        if not low <= value <= high:
            return f"{name} is {value}; from {low} to {high} is possible"
    return None


def state_of(values: dict[str, int]) -> Create2State:
    """Return what values of packets mean; those that are missing count as 0."""
    value = {packet.name: values.get(packet.name, 0) for packet in PACKETS.values()}
    bumps, over, sources = value["bumps_and_drops"], value["overcurrents"], value["charging_sources"]
    return Create2State(
        bump_right=bool(bumps & 1),
        bump_left=bool(bumps & 2),
        drop_right=bool(bumps & 4),
        drop_left=bool(bumps & 8),
        cliffs=tuple(bool(value[f"cliff_{side}"]) for side in SIDES),
        light_near=tuple(bool(value["light_bumper"] >> i & 1) for i in range(len(LIGHTS))),
        light_signals=tuple(value[f"light_{side}"] for side in LIGHTS),
        overcurrent_right=bool(over & 8),
        overcurrent_left=bool(over & 16),
        charging=value["charging_state"] in (1, 2, 3),
        plugged=bool(sources & 1),
        on_dock=bool(sources & 2),
        mode=value["mode"],
        voltage=value["voltage"] / 1000.0,
        current=value["current"] / 1000.0,
        charge=value["charge"],
        capacity=value["capacity"],
        encoder_left=value["encoder_left"],
        encoder_right=value["encoder_right"],
        infrared=tuple(value[f"infrared_{side}"] for side in ("left", "omni", "right")),
        stasis_off=bool(value["stasis"] & 2),
    )


# --- codec --------------------------------------------------------------------------------------------

HEADER = 19

MAX_WHEEL = 500
"""Greatest speed of a wheel, in mm/s."""

STRAIGHT = 0x7FFF
"""The radius that means straight ahead; 0x8000 means the same."""


class Opcode(IntEnum):
    """The opcodes of the Create 2."""

    RESET = 7
    START = 128
    BAUD = 129
    CONTROL = 130
    SAFE = 131
    FULL = 132
    POWER = 133
    SPOT = 134
    CLEAN = 135
    MAX = 136
    DRIVE = 137
    MOTORS = 138
    LEDS = 139
    SONG = 140
    PLAY = 141
    SENSORS = 142
    DOCK = 143
    PWM_MOTORS = 144
    DRIVE_DIRECT = 145
    DRIVE_PWM = 146
    STREAM = 148
    QUERY_LIST = 149
    PAUSE_RESUME = 150
    SCHEDULING_LEDS = 162
    DIGITS_RAW = 163
    DIGITS_ASCII = 164
    BUTTONS = 165
    SCHEDULE = 167
    SET_DAY_TIME = 168
    STOP = 173


DATA_SIZES: dict[int, int] = {
    Opcode.BAUD: 1,
    Opcode.DRIVE: 4,
    Opcode.MOTORS: 1,
    Opcode.LEDS: 3,
    Opcode.PLAY: 1,
    Opcode.SENSORS: 1,
    Opcode.PWM_MOTORS: 3,
    Opcode.DRIVE_DIRECT: 4,
    Opcode.DRIVE_PWM: 4,
    Opcode.PAUSE_RESUME: 1,
    Opcode.SCHEDULING_LEDS: 2,
    Opcode.DIGITS_RAW: 4,
    Opcode.DIGITS_ASCII: 4,
    Opcode.BUTTONS: 1,
    Opcode.SCHEDULE: 15,
    Opcode.SET_DAY_TIME: 3,
}
"""Number of data bytes where it is fixed and not 0; SONG, STREAM and QUERY_LIST count theirs."""


@dataclass(frozen=True, slots=True)
class StreamFrame:
    """A frame of the stream: the ids that were asked for, and the data behind each, joined."""

    ids: tuple[int, ...]
    data: bytes

    def values(self) -> dict[str, int]:
        """Return the values of the packets by name."""
        return values_of(self.ids, self.data)


def command(opcode: Opcode, *data: int) -> bytes:
    """Return a command of single bytes.

    Example:
        >>> command(Opcode.STREAM, 2, 29, 13).hex(" ")
        '94 02 1d 0d'
    """
    return bytes([opcode, *data])


def drive_direct(right: int, left: int) -> bytes:
    """Return the command that sets the speeds of both wheels in mm/s: the right one comes first.

    Raises:
        ValueError: a wheel cannot be as fast.
    """
    if max(abs(right), abs(left)) > MAX_WHEEL:
        raise ValueError(f"wheels at {right} and {left} mm/s; at most {MAX_WHEEL} is possible")
    return struct.pack(">Bhh", Opcode.DRIVE_DIRECT, right, left)


def drive(velocity: int, radius: int = STRAIGHT) -> bytes:
    """Return the command of a speed in mm/s along a radius in mm, positive to the left.

    Raises:
        ValueError: a value is out of range.
    """
    if abs(velocity) > MAX_WHEEL or not (abs(radius) <= 2000 or radius in (STRAIGHT, -0x8000)):
        raise ValueError(f"drive({velocity}, {radius}): at most {MAX_WHEEL} mm/s and 2000 mm are possible")
    return struct.pack(">Bhh", Opcode.DRIVE, velocity, radius)


def stream(ids: tuple[int, ...]) -> bytes:
    """Return the command that starts the stream of these packets."""
    return command(Opcode.STREAM, len(ids), *ids)


def encoded(frame: StreamFrame) -> bytes:
    """Return the bytes of a frame."""
    body, at = bytearray(), 0
    for number in frame.ids:
        size = size_of(number)
        body += bytes([number]) + frame.data[at : at + size]
        at += size
    whole = bytes([HEADER, len(body)]) + body
    return whole + bytes([-sum(whole) % 256])


def decoder(ids: tuple[int, ...] = STREAM) -> SlidingDecoder[StreamFrame]:
    """Return a decoder of the frames that have exactly these packets."""
    places, at = list[tuple[int, int, int]](), 0  # the id, and where its data begins and ends in the body
    for number in ids:
        places.append((number, at + 1, at + 1 + size_of(number)))
        at = places[-1][2]
    count = at

    def parse(stream: bytearray, start: int) -> tuple[StreamFrame, int] | Need:
        if len(stream) < start + 2:
            return "more"
        if stream[start + 1] != count:
            return "other"
        body = start + 2
        if any(body + at <= len(stream) and stream[body + at - 1] != number for number, at, _ in places):
            return "other"
        end = body + count + 1
        if len(stream) < end:
            return "more"
        if sum(stream[start:end]) % 256:
            return "other"
        data = b"".join(stream[body + first : body + last] for _, first, last in places)
        return StreamFrame(ids, data), end

    return SlidingDecoder(parse, bytes([HEADER]))


class CommandReader:
    """Takes commands apart, as the robot does, which has no way to find their beginnings. Mutable."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Return the complete commands: opcodes and data. Unknown opcodes have none."""
        self._data += data
        found: list[tuple[int, bytes]] = []
        while self._data and (size := self._size()) <= len(self._data):
            found.append((self._data[0], bytes(self._data[1:size])))
            del self._data[:size]
        return found

    def _size(self) -> int:
        """Return the size of the first command, as far as it is known."""
        opcode = self._data[0]
        if opcode in (Opcode.STREAM, Opcode.QUERY_LIST):
            return 2 + self._data[1] if len(self._data) > 1 else 2
        if opcode == Opcode.SONG:
            return 3 + 2 * self._data[2] if len(self._data) > 2 else 3
        return 1 + DATA_SIZES.get(opcode, 0)
