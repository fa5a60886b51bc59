"""Dialects: what one kind of device says and understands on its line. Pure: bytes, packets and times.

A driver of a robot is a dialect; all else (threads, the guard, retries, ages, reconnection) is the kernel:

    class Rover(Dialect[RoverPacket]):
        baud = 57600
        stop_bytes = encoded(SPEEDS, 0, 0)

        def decoder(self) -> RoverDecoder: ...
        def opening(self) -> Opening[RoverPacket]: ...
        def read(self, packet: RoverPacket, t_ns: int) -> Readings: ...
        def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> bytes: ...

    def base(port: str, frame_ns: int) -> SerialBase: return SerialBase(Rover(), port, frame_ns=frame_ns)
    def battery(port: str) -> SerialFields: return SerialFields(Rover(), port, {"level": "battery"})
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import Generic, Literal, Protocol, TypeVar

from colony.ir.types import ScalarValue, Value
from colony.runtime.servers.drivers import BaseState

# --- decoder ------------------------------------------------------------------------------------------
#
# Decoders: what a device sends, from bytes to packets. Pure: no I/O, no clock.

Packet = TypeVar("Packet")


class Decoder(Protocol[Packet]):
    """Decodes the bytes of one line, in any pieces. Mutable: keeps the beginning of an unfinished packet.

    A decoder accepts garbage: it never raises, and holds no more bytes than the longest packet has. Where the
    bytes at hand are not a valid packet, it drops the first of them and looks again ("slides"), so that a
    damaged packet, or a false beginning, costs no valid packet behind it. Packets are frozen values, and
    have what the checksum covers; what a packet means is decided by the dialect.

    `tests/drivers/fuzz.py` holds every decoder to that.
    """

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that end within `data`, oldest first."""
        ...


Need = Literal["more", "other"]
"""Why there is no packet at a place: it is not complete, or it is none."""

Parse = Callable[[bytearray, int], tuple[Packet, int] | Need]
"""A function that reads one packet.

Args: the bytes, and the place where a packet may begin, which has the decoder's `start`.
Returns: the packet and the place behind it; "more" if it may be one, but is not complete; "other" if it is
    none, whatever follows. It says "other" as early as it can, for example when the length is impossible.
Raises: ValueError, which stands for "other", such as that of a checksum that is no number.
"""


class SlidingDecoder(Generic[Packet]):
    """A decoder of packets that begin with fixed bytes and have a length and a checksum. Mutable.

    Args:
        parse: reads one packet.
        start: the bytes, at least one, with which each packet begins.

    Example:
        >>> def parse(data: bytearray, at: int) -> tuple[int, int] | Need:
        ...     if len(data) < at + 3:
        ...         return "more"
        ...     value, check = data[at + 1 : at + 3]
        ...     return (value, at + 3) if value ^ check == 0xFF else "other"
        >>> SlidingDecoder(parse, bytes([0xA5])).feed(bytes([0xA5, 1, 0xA5, 7, 0xF8]))
        [7]
    """

    def __init__(self, parse: Parse[Packet], start: bytes) -> None:
        self._parse = parse
        self._start = start
        self._data = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that end within `data`, oldest first."""
        self._data += data
        packets: list[Packet] = []
        at = 0
        while (found := self._data.find(self._start, at)) >= 0:
            try:
                read = self._parse(self._data, found)
            except ValueError:
                read = "other"
            if read == "more":
                at = found
                break
            if read == "other":
                at = found + 1
            else:
                packet, at = read
                packets.append(packet)
        else:
            at = max(at, len(self._data) - len(self._start) + 1)  # the rest may be half of a start
        del self._data[:at]
        return packets


# --- dialect ------------------------------------------------------------------------------------------


class OpeningError(Exception):
    """The device did not answer as its protocol says, or is not the expected one; the text says what to do.

    The kernel reports the text once and tries the opening again, after pauses that double.
    """


class ImplausibleError(ValueError):
    """A reading is outside the device's physics, although its checksum holds; the text says which."""


REFUSALS = (ValueError, LookupError, ArithmeticError, struct.error)
"""Exceptions of `Dialect.read` that refuse a packet: it is implausible, unreadable or too short."""


@dataclass(frozen=True, slots=True)
class Send:
    """A step of an opening: send `data`, then ignore all that comes for `pause_s` seconds.

    The generator is resumed with None. Without data it is a pause.
    """

    data: bytes
    pause_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Ask(Generic[Packet]):
    """A step of an opening: send `data`, then wait for a packet that `accepts` accepts.

    The generator is resumed with that packet, or with None after `timeout_s` seconds. Without data it goes on
    listening.
    """

    data: bytes
    accepts: Callable[[Packet], bool]
    timeout_s: float = 1.0


Opening = Generator[Send | Ask[Packet], Packet | None, None]
"""The opening dialogue of a device: steps, each resumed with its answer. It returns when the device is ready.

    def opening(self) -> Opening[RoverPacket]:
        yield Send(RESET, 0.5)
        if (yield Ask(VERSION, lambda packet: packet.kind == "version")) is None:
            raise OpeningError("no answer: is the robot switched on, and its baud rate 57600?")
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """What one packet measured.

    Attributes:
        base: the state of the base, if the packet has all of it; its `t_ns` is that given to `read`.
        fields: values of single measurements by name, in the units of the server's fields.
        elements: new elements of rings by name, then by index: sonars that are fired in turn. A ring is
            listed in `Dialect.rings`, and gets a value when each of its elements was heard.
    """

    base: BaseState | None = None
    fields: Mapping[str, Value] = field(default_factory=dict)
    elements: Mapping[str, Mapping[int, ScalarValue]] = field(default_factory=dict)


NOTHING = Readings()
"""Readings of a packet that measures nothing, such as an answer of the opening."""


class Dialect(ABC, Generic[Packet]):
    """The protocol of one kind of device. Mutable: may keep what `read` needs between packets.

    The servers of one port that share a process share a dialect, if theirs are made alike: of one class, with
    equal attributes. Other servers of the port have their own, which hear the same bytes, but neither run the
    opening nor send. So what `read` needs to know of the robot is given to the constructor (by the body's
    options), and the opening only checks that it is so.

    Attributes:
        baud: the baud rate where neither the body nor the command line gives one; 0 if it does not matter.
        delay_ns: age of a measurement when its packet has arrived: the device's cycle and transmission.
        stop_bytes: a complete packet (or several) that stops the base whatever it was commanded, and is
            harmless at any time, also before the opening and repeatedly. Other actuators have theirs in
            `SerialActuators`.
        handshake_first: True if a simulator behind TCP has to hear the opening before any stop. The guard
            then sends none on a new connection, and the opening has to stop a base that is still moving.
        goodbye: what ends the session: sent after the stop when no driver needs the port any more.
        rings: number of elements of each ring.
        bounds: least and greatest value of fields and of the elements of arrays; a packet with another value
            is refused as a whole. An element's `math.inf`, no echo, or None, invalid, is always in bounds.
        max_speed, max_turn: greatest speeds in mm/s and deg/s that the base can physically have; a packet
            with a greater one is refused as a whole.
        silent_s: seconds without any packet after which the device counts as lost, and is opened again.
    """

    baud: int = 0
    delay_ns: int = 0
    stop_bytes: bytes = b""
    goodbye: bytes = b""
    handshake_first: bool = False
    rings: Mapping[str, int] = {}
    bounds: Mapping[str, tuple[float, float]] = {}
    max_speed: float = 5_000.0
    max_turn: float = 1_000.0
    silent_s: float = 2.0

    @abstractmethod
    def decoder(self) -> Decoder[Packet]:
        """Return a new decoder; called whenever the line begins again."""

    def opening(self) -> Opening[Packet]:
        """Return the dialogue that makes the device ready; by default there is none.

        Called in the process that commands, whenever the line begins again. Packets that arrive during it
        are answers first, and are read as well.
        """
        return
        yield  # makes this a generator

    def restart(self) -> None:  # a dialect without registers has nothing to forget
        """Forget what counts from the device's last start, such as register values; keep the pose.

        Called whenever the line begins again, before any packet of it is read.
        """

    @abstractmethod
    def read(self, packet: Packet, t_ns: int) -> Readings:
        """Return what a packet measured at `t_ns`, of `time.monotonic_ns`.

        Raises:
            ImplausibleError: a reading is outside the device's physics; the whole packet is refused.
            ValueError: the packet is unreadable and refused; so are those with another of the `REFUSALS`.
        """

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> bytes:
        """Return the bytes that set these speeds (mm/s, deg/s counterclockwise, mm/s to the left).

        They are complete: they set all that moves the base, because the guard sends only the newest of those
        that wait. A keep-alive that the device needs to go on moving is among them, and is sent nowhere else.

        Raises:
            ValueError: the device cannot do that.
        """
        raise ValueError("the device does not drive")

    def watch_bumpers(self, watched: bool) -> None:
        """Let the base itself stop at a bumper or not, from the next `drive` on, if it can stop by itself.

        Nothing is sent: what it takes is among the bytes of `drive`. `RServer` stops at bumpers without it.
        """
        return


# --- opening ------------------------------------------------------------------------------------------
#
# The opening dialogue of a device, step by step. Pure: packets and times are given.


class OpeningRun(Generic[Packet]):
    """An opening that runs. Mutable: one step after the other. Each method raises what the dialogue raises.

    Args:
        opening: the dialogue.
        send: sends the bytes of a step.
        now_ns: the time; the first step begins.
    """

    def __init__(self, opening: Opening[Packet], send: Callable[[bytes], None], now_ns: int) -> None:
        self._opening = opening
        self._send = send
        self._step: Send | Ask[Packet] | None = None
        self._due_ns = 0
        self._go_on(None, now_ns)

    @property
    def is_done(self) -> bool:
        """True once the device is ready."""
        return self._step is None

    def on_packet(self, packet: Packet, now_ns: int) -> None:
        """Take a packet: the answer to a question, if it is accepted."""
        try:
            is_answer = isinstance(self._step, Ask) and self._step.accepts(packet)
        except REFUSALS:  # `accepts` cannot read the packet
            return
        if is_answer:
            self._go_on(packet, now_ns)

    def on_time(self, now_ns: int) -> None:
        """End a pause, or a question without an answer, that is over."""
        if self._step is not None and now_ns >= self._due_ns:
            self._go_on(None, now_ns)

    def _go_on(self, answer: Packet | None, now_ns: int) -> None:
        try:
            step = self._opening.send(answer)
        except StopIteration:
            self._step = None
            return
        if step.data:
            self._send(step.data)
        wait_s = step.timeout_s if isinstance(step, Ask) else step.pause_s
        self._step, self._due_ns = step, now_ns + round(wait_s * 1e9)
