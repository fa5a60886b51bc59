"""A line to a device: a thread that connects to the guard, opens the device, and takes what it measures."""

from __future__ import annotations

import math
import os
import pickle
import sys
import threading
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic

from colony.drivers.dialect import (
    REFUSALS,
    Dialect,
    ImplausibleError,
    OpeningError,
    OpeningRun,
    Packet,
    Readings,
)
from colony.drivers.guarded import (
    Arrived,
    Event,
    GuardConnection,
    GuardedCommand,
    GuardError,
    PortLost,
    SendOutcome,
    Up,
    connect,
)
from colony.drivers.link import TCP, LinkError
from colony.ir.types import ScalarValue, Value
from colony.runtime.kit.background import DeviceBackoff
from colony.runtime.kit.once import OnceReporter, Report, exception_text, failure_text
from colony.runtime.servers.drivers import BaseState, Reading

# --- measurements --------------------------------------------------------------------------------------
#
# The newest measurements of a device, each with its time. Pure: times are given.


class Measurements:
    """What was measured last. Mutable.

    Args:
        rings: number of elements of each ring.
        bounds: least and greatest value of fields and elements.
        max_speed: greatest possible speed of the base, in mm/s, in any direction.
        max_turn: its greatest possible turn rate, in deg/s.
    """

    def __init__(
        self,
        *,
        rings: Mapping[str, int],
        bounds: Mapping[str, tuple[float, float]],
        max_speed: float,
        max_turn: float,
    ) -> None:
        self._rings = rings
        self._bounds = bounds
        self._max_speed = max_speed
        self._max_turn = max_turn
        self._fields: dict[str, tuple[Value, int]] = {}
        self._elements: dict[str, dict[int, tuple[ScalarValue, int]]] = {name: {} for name in rings}
        self.base: BaseState | None = None

    def take(self, readings: Readings, t_ns: int) -> None:
        """Take what a packet measured at `t_ns`, all of it or nothing.

        Raises:
            ImplausibleError: a value is outside the device's physics.
        """
        self._check(readings)
        self.base = readings.base or self.base
        for name, value in readings.fields.items():
            self._fields[name] = value, t_ns
        for name, elements in readings.elements.items():
            self._elements[name].update({i: (value, t_ns) for i, value in elements.items()})

    def clear(self) -> None:
        """Forget everything: the line is lost."""
        self.base = None
        self._fields.clear()
        for elements in self._elements.values():
            elements.clear()

    def readings(self, now_ns: int, names: Collection[str] | None = None) -> Mapping[str, Reading]:
        """Return the fields, and the rings of which each element was heard: as old as the oldest of them.

        With `names`, only those.
        """
        wanted = (*self._fields, *self._rings) if names is None else names
        fields = ((name, self._fields[name]) for name in wanted if name in self._fields)
        found = {name: Reading(value, max(0, now_ns - t_ns)) for name, (value, t_ns) in fields}
        for name in wanted:
            if (size := self._rings.get(name)) is None:
                continue
            elements = self._elements[name]
            if len(elements) == size:
                values = tuple(elements[i][0] for i in range(size))
                found[name] = Reading(values, max(0, now_ns - min(t_ns for _, t_ns in elements.values())))
        return found

    def _check(self, readings: Readings) -> None:
        for name, value in readings.fields.items():
            if not isinstance(value, (tuple, list)):
                self._check_value(name, value)
                continue
            for element in value:
                self._check_element(name, element)
        for name, elements in readings.elements.items():
            for i, value in elements.items():
                if not 0 <= i < self._rings[name]:
                    raise ImplausibleError(f"{name}[{i}]: the ring has {self._rings[name]} elements")
                self._check_element(name, value)
        if (base := readings.base) is not None:
            speed = max(math.hypot(base.speed, base.sideways_speed), abs(base.wheel_speed))
            if not speed <= self._max_speed:
                raise ImplausibleError(
                    f"the base drives at {speed:g} mm/s; at most {self._max_speed:g} is possible"
                )
            if not abs(base.turn_rate) <= self._max_turn:
                text = f"the base turns at {base.turn_rate:g} deg/s; at most {self._max_turn:g} is possible"
                raise ImplausibleError(text)

    def _check_element(self, name: str, value: ScalarValue | None) -> None:
        if value is not None and value != math.inf:
            self._check_value(name, value)

    def _check_value(self, name: str, value: ScalarValue) -> None:
        low, high = self._bounds.get(name, (-math.inf, math.inf))
        if not low <= value <= high:
            raise ImplausibleError(f"{name} is {value}; from {low:g} to {high:g} is possible")


# --- line ----------------------------------------------------------------------------------------------


WAKE_S = 0.02
"""Seconds between two checks of what is due."""

ANSWER_S = 0.13
"""Seconds that a guard has to answer a stop; with `WAKE_S`, it is killed within 150 ms."""

STATUS_S = 10.0
"""Seconds that a guard has to say whether the port is open: it may be opening it."""

SUCCESSOR_PAUSE_S = 0.2
"""Seconds after which a line looks for the successor of a guard that has ended.

A line that commands looks at once, unless the guard ended before it had said whether the port is open.
"""

MAX_REFUSAL_KINDS = 64
"""Maximum number of kinds of refused packets that are counted apart."""

CLOSE_S = 1.0
"""Seconds that the thread has to end when the line is closed."""


def to_stderr(problem: str) -> None:
    """Write a problem into the log of the server."""
    print(problem, file=sys.stderr, flush=True)


def handshake_first(dialect: Dialect[Packet], port: str) -> bool:
    """Return True if a new connection to the device has to hear the opening before any stop."""
    return dialect.handshake_first and port.startswith(TCP)


def check_options(port: object, baud: object) -> None:
    """Check the values that a body gives for a port and its baud rate.

    Raises:
        TypeError: the port is not text, or the baud rate is not a whole number.
    """
    if not isinstance(port, str):
        raise TypeError(f'`port` is {port}; expected text, such as "/dev/ttyUSB0" or "tcp:HOST:PORT"')
    if not str(baud).isdecimal():
        raise TypeError(f"`baud` is {baud}; expected a whole number, such as 115200")


_lines: dict[object, DeviceLine[Any]] = {}
"""The lines of this process that others may listen to."""

_lines_lock = threading.Lock()


def _key(dialect: Dialect[Packet], port: str, baud: int) -> object:
    """Return what lines have in common that may be one: the port, and the dialect before it has read."""
    try:
        made = pickle.dumps(vars(dialect))
    except Exception:  # of a user's class: such lines are not shared
        return object()
    return os.path.abspath(port), baud, type(dialect), made


@dataclass(slots=True)
class LineChannel:
    """What one actuator commands over a line. Mutable.

    Attributes:
        number: its number on the line, from 0.
        command: what is left with the guard.
        question: number of the newest question about it.
        pending: number of the newest question that the guard was asked and has not answered.
        unreached: why the newest stop or decision has not left this computer, or not yet.
    """

    number: int
    command: GuardedCommand
    question: int = 0
    pending: int | None = None
    unreached: str | None = None


class DeviceLine(Generic[Packet]):
    """A line to one device. Mutable; shared by its thread and those of servers.

    A line with channels opens and commands the device; others only listen.

    Args:
        dialect: the protocol; used by the thread alone, but for `drive` and other commands.
        port: what `link.open_link` opens.
        baud: the baud rate; 0 for that of the dialect.
        report: takes each kind of problem once in each outage, and the end of the outage.
    """

    def __init__(self, dialect: Dialect[Packet], port: str, baud: int, report: Report) -> None:
        self.dialect = dialect
        self._port = port
        self._baud = baud or dialect.baud
        self._first_bytes = b"" if handshake_first(dialect, port) else dialect.stop_bytes
        self._channels: list[LineChannel] = []  # grows only
        self._greeted = 0  # number of channels that the guard knows
        self._report = report
        self._problems: OnceReporter | None = None
        self._refused = Counter[str]()
        self._problem: str | None = None
        self._lock = threading.Lock()
        self._measured = Measurements(
            rings=dialect.rings,
            bounds=dialect.bounds,
            max_speed=dialect.max_speed,
            max_turn=dialect.max_turn,
        )
        self._decoder = dialect.decoder()
        self._opening: OpeningRun[Packet] | None = None
        self._is_ready = False
        self._heard_ns = 0
        self._heard_bytes = self._heard_packets = 0
        self._connection: GuardConnection | None = None
        self._knows_port = False  # the guard has said whether the port is open
        self._questions = 0
        self._asked_ns = 0
        self._answer_due: float | None = None
        self.drivers = 1
        self._key: object = None
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"line {port}", daemon=True)

    def begin(self) -> DeviceLine[Packet]:
        """Begin to connect."""
        self._thread.start()
        return self

    @classmethod
    def listening(cls, dialect: Dialect[Packet], port: str, baud: int, report: Report) -> DeviceLine[Packet]:
        """Return a line that commands nothing: one of this process with the same port and dialect, if any.

        So the packets of a line are decoded once in a process, however many servers it has.
        """
        key = _key(dialect, port, baud)
        with _lines_lock:
            if (line := _lines.get(key)) is not None:
                line.drivers += 1
                return line
            line = cls(dialect, port, baud, report)
            _lines[key], line._key = line, key
        return line.begin()

    @classmethod
    def commanding(
        cls,
        dialect: Dialect[Packet],
        port: str,
        baud: int,
        commands: Sequence[GuardedCommand],
        report: Report,
    ) -> tuple[DeviceLine[Packet], Sequence[LineChannel]]:
        """Return a line that opens and commands the device, and a channel of it for each command.

        It is one that commands already, if one of this process has the same port and dialect; a guard refuses
        another one. A second driver of an actuator, which has its stop, gets no part of that line.
        """
        key = _key(dialect, port, baud)
        stops = {command.stop for command in commands}
        with _lines_lock:
            line = _lines.get(key)
            if line is not None and line._channels:
                if stops.isdisjoint(channel.command.stop for channel in line._channels):
                    line.drivers += 1
                    return line, line._add(commands)
                key = object()
            line = cls(dialect, port, baud, report)
            channels = line._add(commands)
            _lines[key], line._key = line, key
        return line.begin(), channels

    def _add(self, commands: Sequence[GuardedCommand]) -> Sequence[LineChannel]:
        added = [LineChannel(number, command) for number, command in enumerate(commands, len(self._channels))]
        self._channels += added
        return added

    # --- called by the server ------------------------------------------------------------------------

    @property
    def problem(self) -> str | None:
        """Why the device does not work, from its first failure until it works again; else None."""
        return self._problem if self._problems is not None else None

    @property
    def is_opening(self) -> bool:
        """True while the device is being opened, and has not failed."""
        return not self._is_ready and self._problems is None

    def decide(self, channel: LineChannel, data: bytes, *, confirms: bool = False) -> None:
        """Send bytes that carry out the frame that is being decided, in the thread that decides it.

        With `confirms`, `unreached` says what has become of them.

        Raises:
            OSError: the device is not ready, or the guard has ended.
        """
        connection = self._connection
        if connection is None or not self._is_ready or channel.number >= self._greeted:
            raise ConnectionError(f"the device is not ready: {self._problem or 'it is being opened'}")
        connection.decide(data, time.monotonic_ns(), channel.number)
        if confirms:
            self._ask_sent(connection, channel)

    def stop(self, channel: LineChannel) -> None:
        """Send the stop of a channel, if the device is ready; `unreached` says what has become of it.

        Until then nothing was decided since the stop of the guard, and without a guard nothing could move the
        device. More stops would disturb the handshake of a device that takes each packet for a part of it.

        Raises:
            OSError: the guard has just ended.
        """
        self._ask_sent(self._connection, channel, stops=self._is_ready)

    def _ask_sent(
        self, connection: GuardConnection | None, channel: LineChannel, *, stops: bool = False
    ) -> None:
        """Ask the guard to stop, or only whether it has sent what it was given last."""
        with self._lock:
            self._questions += 1
            channel.question = self._questions
            channel.unreached = f"{self._port}: the guard has not sent it"
        if connection is not None and self._knows_port and channel.number < self._greeted:
            self._expect(connection, channel, stops=stops)

    def unreached(self, channel: LineChannel) -> str | None:
        """Return why the newest stop has not left this computer, or not yet; None once it has."""
        if channel.unreached is None or self._is_ready:
            return channel.unreached
        return self._problem or channel.unreached

    def base(self) -> BaseState | None:
        """Return the newest state of the base; None until the device is ready."""
        with self._lock:
            return self._measured.base if self._is_ready else None

    def readings(self, names: Collection[str]) -> Mapping[str, Reading]:
        """Return the newest of these measurements with their ages."""
        with self._lock:
            return self._measured.readings(time.monotonic_ns(), names)

    def close(self) -> None:
        """End the connection, with the last driver of the line: the guard stops the base. Idempotent."""
        with _lines_lock:
            self.drivers -= 1
            if self.drivers > 0:
                return
            if _lines.get(self._key) is self:
                del _lines[self._key]
        self._closed.set()
        if (connection := self._connection) is not None:
            connection.close()
        self._thread.join(CLOSE_S)

    # --- the thread ----------------------------------------------------------------------------------

    def _run(self) -> None:
        pauses = DeviceBackoff()
        while not self._closed.is_set():
            began = time.monotonic()
            try:
                commands = [channel.command for channel in tuple(self._channels)]
                connection = connect(self._port, self._baud, self._first_bytes, *commands)
                self._serve(connection, len(commands))
            except (Exception, SystemExit) as problem:
                self._lose(problem)
                if isinstance(problem, GuardError):
                    pauses.reset()
                    is_at_once = self._knows_port and self._channels
                    self._closed.wait(0.0 if is_at_once else SUCCESSOR_PAUSE_S)
                    continue
            self._closed.wait(pauses.after(time.monotonic() - began))

    def _serve(self, connection: GuardConnection, greeted: int) -> None:
        """Take what arrives, until the connection or the device is lost, which raises."""
        self._knows_port, self._answer_due = False, time.monotonic() + STATUS_S
        for channel in self._channels:
            channel.pending = None
        self._connection, self._greeted = connection, greeted
        wake_s = WAKE_S if self._channels else 10 * WAKE_S
        try:
            while not self._closed.is_set():
                event = connection.receive(wake_s)
                if event is None:
                    self._expect_answer(connection)
                self._take(connection, event)
        except ConnectionError:  # what the guard said before it closed the connection is still there
            while True:
                connection.receive(0.0)
        finally:
            self._connection, self._is_ready, self._opening = None, False, None
            connection.close()

    def _expect(self, connection: GuardConnection, channel: LineChannel, *, stops: bool) -> None:
        """Expect an answer to what the guard is asked here."""
        self._asked_ns = time.monotonic_ns()
        with self._lock:
            self._answer_due = self._answer_due or time.monotonic() + ANSWER_S
            number = channel.pending = channel.question
        connection.ask_sent(number, channel.number, stops=stops)

    def _expect_all(self, connection: GuardConnection, *, stops: bool) -> None:
        """Ask again for each channel that is not known to be reached."""
        for channel in self._channels[: self._greeted]:
            if channel.unreached is not None:
                self._expect(connection, channel, stops=stops)

    def _greet_late(self, connection: GuardConnection) -> None:
        """Greet for channels that were added after the connection, which must not disturb the opening."""
        for channel in self._channels[self._greeted :]:
            connection.greet(channel.number, channel.command)
            self._greeted += 1
            if channel.unreached is not None:
                self._expect(connection, channel, stops=True)

    def _expect_answer(self, connection: GuardConnection) -> None:
        """Kill a guard that has not answered in time, although nothing is left to be read.

        Raises:
            GuardError: it was killed.
        """
        if self._answer_due is not None and time.monotonic() >= self._answer_due:
            connection.kill_guard()
            raise GuardError(f"the guard of {self._port} did not answer, and was killed")

    def _take(self, connection: GuardConnection, event: Event | None) -> None:
        match event:
            case Up(baud=baud):
                self._knows_port, self._answer_due = True, None
                self._begin(connection, baud)
                self._expect_all(connection, stops=self._is_ready)
            case PortLost(why=why):
                self._knows_port, self._answer_due = True, None
                self._is_ready, self._opening = False, None
                self._lose(LinkError(why))
            case SendOutcome(number=number, why=why):
                with self._lock:
                    for channel in self._channels:
                        if number == channel.question:
                            channel.unreached = f"{self._port}: {why}" if why else None
                        if number == channel.pending:
                            channel.pending = None
                    is_pending = any(channel.pending is not None for channel in self._channels)
                    self._answer_due = time.monotonic() + ANSWER_S if is_pending else None
            case Arrived(data=data, t_ns=t_ns):
                self._heard_bytes += len(data)
                for packet in self._decoder.feed(data):
                    self._hear(packet, t_ns)
            case None:
                pass
        now_ns = time.monotonic_ns()
        if self._opening is not None:
            self._opening.on_time(now_ns)
            self._end_opening(now_ns)
        elif self._is_ready and now_ns - self._heard_ns > self.dialect.silent_s * 1e9:
            self._lose_silent()
        elif self._is_ready and self._channels:
            self._greet_late(connection)
            if now_ns - max(self._heard_ns, self._asked_ns) > self.dialect.silent_s * 5e8:
                self._ask_sent(connection, self._channels[0])  # the guard may be frozen

    def _begin(self, connection: GuardConnection, baud: int) -> None:
        if baud != self._baud:
            text = f"the guard of {self._port} runs at {baud} baud, and this driver needs {self._baud}"
            raise LinkError(f"{text}: give all servers of the port the same `baud`, and end them first")
        self._decoder = self.dialect.decoder()
        self._heard_bytes = self._heard_packets = 0
        self.dialect.restart()
        self._is_ready, self._heard_ns = not self._channels, time.monotonic_ns()
        if self._channels:
            now_ns = time.monotonic_ns()
            self._opening = OpeningRun(self.dialect.opening(), connection.send, now_ns)
            self._end_opening(now_ns)

    def _end_opening(self, now_ns: int) -> None:
        if self._opening is not None and self._opening.is_done:
            self._opening, self._is_ready, self._heard_ns = None, True, now_ns
            self._note_success()
            if self._connection is not None:
                self._expect_all(self._connection, stops=True)

    def _lose_silent(self) -> None:
        silence = f"nothing was heard for {self.dialect.silent_s:g} s"
        if self._channels:
            raise OpeningError(f"{silence}: the device is opened again")
        self._lose(OpeningError(f"{silence}: does RServer run, whose driver opens the device?"))

    def _hear(self, packet: Packet, t_ns: int) -> None:
        """Take a packet: what it measures, and what it answers."""
        self._heard_ns = t_ns
        self._heard_packets += 1
        if self._opening is not None:
            self._opening.on_packet(packet, time.monotonic_ns())
        try:
            measured_ns = t_ns - self.dialect.delay_ns
            readings = self.dialect.read(packet, measured_ns)
            with self._lock:
                self._measured.take(readings, measured_ns)
        except REFUSALS as problem:
            self._count_refusal(problem)
        if self._is_ready:
            self._note_success()

    def _count_refusal(self, problem: Exception) -> None:
        """Count a refused packet; report the 1st, 10th, 100th and so on of each measurement or exception."""
        text = exception_text(problem)
        is_implausible = isinstance(problem, ImplausibleError)
        kind = text.partition(" ")[0] if is_implausible else type(problem).__name__
        if kind not in self._refused and len(self._refused) >= MAX_REFUSAL_KINDS:
            kind = ""
        self._refused[kind] += 1
        count = self._refused[kind]
        if str(count).strip("0") == "1":
            what = "a packet was" if count == 1 else f"{count} packets were"
            cause = text if is_implausible else f"{type(problem).__name__}: {text}"
            self._report(f"{what} refused: {cause}")

    def _note_success(self) -> None:
        self._problem = None
        if self._problems is not None:
            self._problems = None
            self._report(f"the device at {self._port} works again")

    def _lose(self, problem: BaseException) -> None:
        """Forget what was measured, and report the problem, once in an outage."""
        with self._lock:
            self._measured.clear()
        if self._closed.is_set():
            return
        is_known = isinstance(problem, LinkError | OpeningError)
        text = exception_text(problem)
        if isinstance(problem, OpeningError) and self._heard_bytes and not self._heard_packets:
            rate = "" if self._port.startswith(TCP) else f": it may not speak at {self._baud} baud"
            text += f" (bytes arrive, and no packet is among them{rate})"
        self._problem = text if is_known else f"{type(problem).__name__}: {text}"
        self._problems = self._problems or OnceReporter(self._report)
        full = text if is_known else failure_text(f"the line to {self._port}", problem)
        self._problems.report("", text if is_known else type(problem).__name__, full)
