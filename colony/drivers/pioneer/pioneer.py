"""The dialect of Pioneer robots, and their drivers, for the bodies of robots.

A Pioneer goes on moving as long as it hears a packet every 2 s. So the driver sends no PULSE: each decided
frame sends VEL and RVEL; where no frame is decided, the guard stops the robot, and so does its watchdog.

Source: Pioneer 3 operations manual, and what happened to others (docs/pioneer.md).
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import replace

from colony.drivers.dialect import (
    NOTHING,
    Ask,
    Decoder,
    Dialect,
    ImplausibleError,
    Opening,
    OpeningError,
    Readings,
    Send,
)
from colony.drivers.odometry import OdometryPose, Registers
from colony.drivers.pioneer.codec import CommandNumber, command, decoder
from colony.drivers.pioneer.parameters import MODELS, Parameters, parameters_of
from colony.drivers.pioneer.sip import (
    MOVING,
    STOPPED,
    ConfigSip,
    SipIdentity,
    StandardSip,
    mask_of,
    may_drive,
    read_sip,
)
from colony.drivers.serial_base import SerialBase, SerialFields
from colony.ir.types import ScalarValue, Value
from colony.runtime.servers.drivers import BaseState

# --- handshake ----------------------------------------------------------------------------------------
#
# The handshake of Pioneer robots: SYNC0 to SYNC2, OPEN, the check of the model, the settings. Pure.
#
# Source: Pioneer 3 operations manual; Player, for closing a session; AMRISim (docs/tried-with.md).

SETTLE_S = 0.5
"""Time before the handshake, in which the stop of a new guard is repeated, and an open session is heard."""

CLOSE_S = 0.4
"""Pause after an older session was closed (Player)."""

ATTEMPTS = 5

CONFIG = 0x20


def handshake(model: str, baud: int, stop: bytes) -> Opening[bytes]:
    """Return the dialogue after which a session is open with a robot of this model, which stands.

    A session that is open already goes on after `stop`, if the robot gives its configuration.

    Raises:
        OpeningError: no robot answers, it is another model, or its watchdog is off.
    """
    config = None
    if (yield Ask(b"", is_standard, SETTLE_S)) is not None:
        config = yield from _configuration(stop)
        if config is None:
            yield Send(command(CommandNumber.CLOSE), CLOSE_S)
    if config is not None:
        _expect_model(config.identity, model)
    else:
        _expect_model((yield from _synchronized(baud)), model)
        if (yield Ask(command(CommandNumber.OPEN), is_standard)) is None:
            raise OpeningError("the robot answers, but sends no state: switch it off and on")
        config = yield from _configuration()
    if config is not None and config.watchdog_ms == 0:
        raise OpeningError("the robot's watchdog is off: set WatchDog to 2000 ms with ARCOScfg")


def set_up(settings: bytes) -> Opening[bytes]:
    """Return the dialogue that sends settings until the robot shows that its motors are on.

    Commands are not acknowledged, and may be lost on the line. It ends in any case: a pressed stop button
    keeps the motors off.
    """
    for _ in range(ATTEMPTS):
        if (yield Ask(settings, may_drive)) is not None:
            return


def is_standard(data: bytes) -> bool:
    """Return whether a packet is a standard one, which only open sessions send."""
    return data[0] in (STOPPED, MOVING)


def _synchronized(baud: int) -> Generator[Send | Ask[bytes], bytes | None, SipIdentity]:
    """Return the identity of the robot, after SYNC0, SYNC1 and SYNC2; a wrong answer begins again."""
    for _ in range(ATTEMPTS):
        for number in (0, 1, 2):
            answer = yield Ask(command(number), _any)
            if answer is None or answer[0] != number:
                break
        if answer is not None and is_standard(answer):  # an older session is open
            yield Send(command(CommandNumber.CLOSE), CLOSE_S)
        elif answer is not None and isinstance(identity := read_sip(answer), SipIdentity):
            return identity
    raise OpeningError(f"no Pioneer answers: is it switched on, its cable plugged in, its baud rate {baud}?")


def _configuration(before: bytes = b"") -> Generator[Send | Ask[bytes], bytes | None, ConfigSip | None]:
    """Return the configuration of an open session, asked for after `before`.

    It is None if none comes: some robots send it with a wrong checksum.
    """
    answer = yield Ask(before + command(CommandNumber.CONFIG, 1), lambda data: data[0] == CONFIG)
    config = None if answer is None else read_sip(answer)
    return config if isinstance(config, ConfigSip) else None


def _any(data: bytes) -> bool:
    return True


def _expect_model(identity: SipIdentity, model: str) -> None:
    if identity.model.casefold() != model.casefold():
        known = " (no row of its model is known)" if parameters_of(identity.model) is None else ""
        raise OpeningError(
            f"the robot {identity.name} is a {identity.model}{known}, and the body says model = {model!r}"
        )


# --- pioneer ------------------------------------------------------------------------------------------

BAUD = 9600
"""The baud rate of a robot that nobody has set otherwise."""

CYCLE_NS = 100_000_000
"""The period of standard packets: so old the oldest reading is when its packet is sent."""

PACKET_BITS = 600
"""Bits on the line of a standard packet with the readings of two arrays."""

REPEATED_AFTER = 20
"""Number of frames after which a setting is sent again: nothing says whether the robot has heard it."""

SONAR_CYCLES_MS = (2, 120)
"""Shortest and longest time from one sonar of an array to the next (manual)."""

NO_ECHO_MM = 5000.0  # from here on a sonar has heard nothing

EMPTY_V, FULL_V = 11.0, 12.8
"""Voltages of empty and full batteries of 12 V; the level between them is a rough guess."""

OPTION_KINDS = {"model": ((str,), "a text"), "joystick": ((bool,), "true or false")}
NUMBER = ((int, float), "a number")
"""Types of the options that are no numbers, and of those that are: a joystick that is "no" may not drive."""


class Pioneer(Dialect[bytes]):
    """The dialect. Mutable: has the pose by dead reckoning.

    Fields: battery (percent), volts, charging, motors_off, stop_button, stalled.
    Ring: sonar (mm).

    Args:
        model: the subclass that the robot names, whose row says what its numbers mean.
        sonars: number of sonars, the first of the model; 0 for all that it may have.
        front_bumpers, rear_bumpers: number of segments; None for those of the model. Robots without bumpers
            report pressed ones.
        acceleration, turn_acceleration: with which it speeds up and brakes, in mm/s^2 and deg/s^2; 0 leaves
            them as they are.
        sonar_cycle: time in ms that each sonar has for its echo, which is its time-out; 0 leaves it as it is.
        joystick: whether a joystick at the robot's own port may drive it, too.
    """

    baud = BAUD
    stop_bytes = command(CommandNumber.ESTOP) + command(CommandNumber.VEL, 0) + command(CommandNumber.RVEL, 0)
    goodbye = command(CommandNumber.CLOSE)
    handshake_first = True  # AMRISim takes whatever comes first for SYNC0, and never answers that

    def __init__(
        self,
        model: str = "p3dx-sh",
        *,
        baud: int = BAUD,
        sonars: int = 0,
        front_bumpers: int | None = None,
        rear_bumpers: int | None = None,
        acceleration: int = 0,
        turn_acceleration: int = 0,
        sonar_cycle: int = 0,
        joystick: bool = False,
    ) -> None:
        self._row = _row(model)
        own = len(self._row.sonars)
        if not 0 <= sonars <= own:
            raise ValueError(f"sonars is {sonars}; a {self._row.model} has up to {own}")
        self._front = mask_of(self._row.front_bumpers if front_bumpers is None else front_bumpers)
        self._rear = mask_of(self._row.rear_bumpers if rear_bumpers is None else rear_bumpers)
        self._settings = [command(CommandNumber.ENABLE, 1), command(CommandNumber.SONAR, 1)]
        if acceleration:
            self._settings += [command(CommandNumber.SETA, sign * acceleration) for sign in (1, -1)]
        if turn_acceleration:
            self._settings += [command(CommandNumber.SETRA, sign * turn_acceleration) for sign in (1, -1)]
        if sonar_cycle:
            self._settings.append(command(CommandNumber.SONAR_CYCLE, _cycle(sonar_cycle)))
        if joystick:
            self._settings.append(command(CommandNumber.JOYDRIVE, 1))
        self._bump_stall = b""
        self._frames_since_stall = 0
        self.rings = {"sonar": sonars or own}
        self.bounds = {"sonar": (0.0, NO_ECHO_MM), "volts": (0.0, 60.0)}
        self.max_speed = 1.2 * self._row.max_speed
        self.max_turn = 1.2 * self._row.max_turn
        self.delay_ns = CYCLE_NS + PACKET_BITS * 1_000_000_000 // (baud or BAUD)
        turn_bits = (self._row.turn_units - 1).bit_length()
        self._position = Registers(15, 15, max_rate=self.max_speed / self._row.distance)
        self._heading = Registers(turn_bits, max_rate=self.max_turn * self._row.turn_units / 360.0)
        self._pose = OdometryPose()

    def decoder(self) -> Decoder[bytes]:
        """Return a decoder of the data of packets."""
        return decoder()

    def restart(self) -> None:
        """Count from the next values of the registers on; keep the pose."""
        self._position.restart()
        self._heading.restart()

    def opening(self) -> Opening[bytes]:
        """Return the handshake, the check of the model, and the settings; a session that is open goes on."""
        yield from handshake(self._row.model, self.baud, self.stop_bytes)
        yield from set_up(b"".join(self._settings))

    def read(self, packet: bytes, t_ns: int) -> Readings:
        """Return what a standard packet measured.

        Raises:
            ImplausibleError: the registers moved farther than the robot can.
        """
        sip = read_sip(packet) if is_standard(packet) else None
        if not isinstance(sip, StandardSip):
            if is_standard(packet):
                raise ImplausibleError("a standard packet ends too early")
            return NOTHING
        return Readings(
            base=self._base(sip, t_ns), fields=_fields(sip), elements={"sonar": self._ranges(sip)}
        )

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> bytes:
        """Return both set points, each of which the robot keeps until another is sent."""
        if sideways:
            raise ValueError("a Pioneer does not drive sideways")
        speeds = command(CommandNumber.VEL, round(velocity)) + command(CommandNumber.RVEL, round(turn))
        return speeds + self._due_setting()

    def watch_bumpers(self, watched: bool) -> None:
        """Stall the robot where its front bumper meets something ahead, or its rear one behind, or not."""
        bumpers = bool(self._front) | bool(self._rear) << 1
        self._bump_stall = command(CommandNumber.BUMPSTALL, bumpers if watched else 0)
        self._frames_since_stall = 0

    def _due_setting(self) -> bytes:
        """Return what `watch_bumpers` has set, in one of `REPEATED_AFTER` frames, the first among them."""
        is_due = self._frames_since_stall % REPEATED_AFTER == 0
        self._frames_since_stall += 1
        return self._bump_stall if is_due else b""

    def _base(self, sip: StandardSip, t_ns: int) -> BaseState:
        row = self._row
        self._heading.step((sip.heading,), t_ns)  # only whether it can be
        (ahead, left), _ = self._position.step((sip.x, sip.y), t_ns)
        heading = sip.heading % row.turn_units * 360.0 / row.turn_units
        self._pose = replace(
            self._pose,
            x=self._pose.x - left * row.distance,  # the robot's x axis is north at heading 0, its y axis west
            y=self._pose.y + ahead * row.distance,
            heading=heading,
        )
        left_speed, right_speed = sip.left_speed * row.speed, sip.right_speed * row.speed
        rate = row.turn_rate(left_speed, right_speed) if sip.turn_rate is None else sip.turn_rate / 10.0
        return BaseState(
            t_ns=t_ns,
            x=self._pose.x,
            y=self._pose.y,
            heading=heading,
            front_bumper=bool(sip.front_bumpers & self._front),
            rear_bumper=bool(sip.rear_bumpers & self._rear),
            speed=(left_speed + right_speed) / 2.0,
            turn_rate=rate,
            wheel_speed=(abs(left_speed) + abs(right_speed)) / 2.0,
        )

    def _ranges(self, sip: StandardSip) -> dict[int, ScalarValue]:
        """Return the new ranges of the sonars that are read, in mm."""
        found: dict[int, ScalarValue] = {}
        for number, units in sip.sonars:
            if number < self.rings["sonar"]:
                mm = units * self._row.range
                found[number] = mm if mm < NO_ECHO_MM else math.inf
        return found


def _fields(sip: StandardSip) -> dict[str, Value]:
    volts = (sip.battery if sip.battery_fine is None else sip.battery_fine) / 10.0
    fields: dict[str, Value] = {
        "volts": volts,
        "battery": min(100.0, max(0.0, 100.0 * (volts - EMPTY_V) / (FULL_V - EMPTY_V))),
        "stalled": sip.left_stalled or sip.right_stalled,
    }
    if sip.battery_fine is not None:  # older firmware has something else in its flags
        fields |= {"motors_off": not sip.flags & 1, "stop_button": bool(sip.flags >> 5 & 1)}
    if sip.charge is not None:
        fields["charging"] = sip.charge > 0
    return fields


def _row(model: str) -> Parameters:
    row = parameters_of(model)
    if row is None:
        raise ValueError(f"no model {model!r}; known are {', '.join(sorted(MODELS))}")
    return row


def _cycle(cycle_ms: int) -> int:
    low, high = SONAR_CYCLES_MS
    if not low <= cycle_ms <= high:
        raise ValueError(f"sonar_cycle is {cycle_ms} ms; {low} to {high} ms are possible")
    return cycle_ms


def base(port: str, *, frame_ns: int, baud: int = 0, **options: bool | float | str) -> SerialBase[bytes]:
    """Return the driver of `RServer`; `options` are those of `Pioneer`."""
    return SerialBase(_dialect(baud, options), port, baud=baud, frame_ns=frame_ns)


def sonar(port: str, *, baud: int = 0, **options: bool | float | str) -> SerialFields[bytes]:
    """Return the driver of a server with the field `range`."""
    return SerialFields(_dialect(baud, options), port, {"range": "sonar"}, baud=baud)


def battery(port: str, *, baud: int = 0, **options: bool | float | str) -> SerialFields[bytes]:
    """Return the driver of a server with the fields `level` and `charging`."""
    return SerialFields(
        _dialect(baud, options), port, {"level": "battery", "charging": "charging"}, baud=baud
    )


def panel(port: str, *, baud: int = 0, **options: bool | float | str) -> SerialFields[bytes]:
    """Return the driver of a server with the fields `estop`, `motors_off` and `stalled`."""
    names = {"estop": "stop_button", "motors_off": "motors_off", "stalled": "stalled"}
    return SerialFields(_dialect(baud, options), port, names, baud=baud)


def _dialect(baud: int, options: dict[str, bool | float | str]) -> Pioneer:
    for name, value in options.items():
        kinds, text = OPTION_KINDS.get(name, NUMBER)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            raise ValueError(f"{name} is {value!r}; it is {text}")
    whole = {name: round(value) if isinstance(value, float) else value for name, value in options.items()}
    return Pioneer(baud=baud, **whole)  # type: ignore[arg-type]  # checked where they are used
