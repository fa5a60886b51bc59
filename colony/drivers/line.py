"""A line to a device: a thread that connects to the guard, opens the device, and takes what it measures."""

from __future__ import annotations

import os
import pickle
import sys
import threading
import time
from collections.abc import Collection, Mapping
from typing import Any, Generic

from colony.drivers.decoder import Packet
from colony.drivers.dialect import REFUSALS, Dialect, OpeningError
from colony.drivers.guarded import (
    Arrived,
    Command,
    Event,
    GuardConnection,
    GuardError,
    Lost,
    Sent,
    Up,
    connect,
)
from colony.drivers.link import TCP, LinkError
from colony.drivers.measurements import Measurements
from colony.drivers.opening import OpeningRun
from colony.runtime.kit.background import next_pause_s
from colony.runtime.kit.once import OnceReporter, Report, exception_text, failure_text
from colony.runtime.servers.drivers import BaseState, Reading

WAKE_S = 0.02
"""Seconds between two checks of what is due."""

ANSWER_S = 0.13
"""Seconds that a guard has to answer a stop; with `WAKE_S`, it is killed within 150 ms."""

STATUS_S = 10.0
"""Seconds that a guard has to say whether the port is open: it may be opening it."""

SUCCESSOR_PAUSE_S = 0.2
"""Seconds after which a line that only listens looks for the successor of a guard that has ended."""

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


_lines: dict[object, Line[Any]] = {}
"""The lines of this process that others may listen to."""

_lines_lock = threading.Lock()


def _key(dialect: Dialect[Packet], port: str, baud: int) -> object:
    """Return what lines have in common that may be one: the port, and the dialect before it has read."""
    try:
        made = pickle.dumps(vars(dialect))
    except Exception:  # of a user's class: such lines are not shared
        return object()
    return os.path.abspath(port), baud, type(dialect), made


class Line(Generic[Packet]):
    """A line to one device. Mutable; shared by its thread and those of servers.

    Args:
        dialect: the protocol; used by the thread alone, but for `drive`.
        port: what `link.open_link` opens.
        baud: the baud rate; 0 for that of the dialect.
        command: what is left with the guard, for the line that opens and commands the device; else None.
        report: takes each kind of problem once in each outage, and the end of the outage.
    """

    def __init__(
        self, dialect: Dialect[Packet], port: str, baud: int, command: Command | None, report: Report
    ) -> None:
        self._dialect = dialect
        self._port = port
        self._baud = baud or dialect.baud
        self._first_bytes = b"" if handshake_first(dialect, port) else dialect.stop_bytes
        self._command = command
        self._report = report
        self._problems: OnceReporter | None = None
        self._implausible = OnceReporter(report)
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
        self._asked_number = 0
        self._asked_ns = 0
        self._unreached: str | None = None
        self._answer_due: float | None = None
        self.drivers = 1
        self._key: object = None
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"line {port}", daemon=True)

    def begin(self) -> Line[Packet]:
        """Begin to connect."""
        self._thread.start()
        return self

    @classmethod
    def listening(cls, dialect: Dialect[Packet], port: str, baud: int, report: Report) -> Line[Packet]:
        """Return a line that commands nothing: one of this process with the same port and dialect, if any.

        So the packets of a line are decoded once in a process, however many servers it has.
        """
        key = _key(dialect, port, baud)
        with _lines_lock:
            if (line := _lines.get(key)) is not None:
                line.drivers += 1
                return line
            line = cls(dialect, port, baud, None, report)
            line._share(key)
        return line.begin()

    @classmethod
    def commanding(
        cls, dialect: Dialect[Packet], port: str, baud: int, command: Command, report: Report
    ) -> Line[Packet]:
        """Return a line that opens and commands the device, for others of this process to listen to."""
        key = _key(dialect, port, baud)
        line = cls(dialect, port, baud, command, report)
        with _lines_lock:
            if key not in _lines:
                line._share(key)
        return line.begin()

    def _share(self, key: object) -> None:
        _lines[key], self._key = self, key

    # --- called by the server ------------------------------------------------------------------------

    @property
    def problem(self) -> str | None:
        """Why the device does not work, from its first failure until it works again; else None."""
        return self._problem if self._problems is not None else None

    @property
    def is_opening(self) -> bool:
        """True while the device is being opened, and has not failed."""
        return not self._is_ready and self._problems is None

    def decide(self, data: bytes, *, confirms: bool = False) -> None:
        """Send bytes that carry out the frame that is being decided, in the thread that decides it.

        With `confirms`, `unreached` says what has become of them.

        Raises:
            OSError: the device is not ready, or the guard has ended.
        """
        connection = self._connection
        if connection is None or not self._is_ready:
            raise ConnectionError(f"the device is not ready: {self._problem or 'it is being opened'}")
        connection.decide(data, time.monotonic_ns())
        if confirms:
            self._ask_sent(connection)

    def stop(self) -> None:
        """Send the stop, if the device is ready; `unreached` says what has become of it.

        Until then nothing was decided since the stop of the guard, and without a guard nothing could move the
        base. More stops would disturb the handshake of a device that takes each packet for a part of it.

        Raises:
            OSError: the guard has just ended.
        """
        self._ask_sent(self._connection, stops=self._is_ready)

    def _ask_sent(self, connection: GuardConnection | None, *, stops: bool = False) -> None:
        """Ask the guard to stop, or only whether it has sent what it was given last."""
        with self._lock:
            self._asked_number += 1
            self._unreached = f"{self._port}: the guard has not sent it"
        if connection is not None and self._knows_port:
            self._expect(connection, stops=stops)

    @property
    def unreached(self) -> str | None:
        """Why the newest stop has not left this computer, or not yet; None once it has."""
        if self._unreached is None or self._is_ready:
            return self._unreached
        return self._problem or self._unreached

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
            _lines.pop(self._key, None)
        self._closed.set()
        if (connection := self._connection) is not None:
            connection.close()
        self._thread.join(CLOSE_S)

    # --- the thread ----------------------------------------------------------------------------------

    def _run(self) -> None:
        pause_s = 0.0
        while not self._closed.is_set():
            began = time.monotonic()
            try:
                self._serve(connect(self._port, self._baud, self._first_bytes, self._command))
            except (Exception, SystemExit) as problem:
                self._lose(problem)
                if isinstance(problem, GuardError) and self._knows_port:
                    pause_s = 0.0
                    self._closed.wait(0.0 if self._command is not None else SUCCESSOR_PAUSE_S)
                    continue
            pause_s = next_pause_s(pause_s, time.monotonic() - began)
            self._closed.wait(pause_s)

    def _serve(self, connection: GuardConnection) -> None:
        """Take what arrives, until the connection or the device is lost, which raises."""
        self._knows_port, self._answer_due = False, time.monotonic() + STATUS_S
        self._connection = connection
        wake_s = WAKE_S if self._command is not None else 10 * WAKE_S
        try:
            while not self._closed.is_set():
                event = connection.receive(wake_s)
                if event is None:
                    self._expect_answer(connection)
                self._take(connection, event)
        except BrokenPipeError:  # what the guard said before it closed the connection is still there
            while True:
                connection.receive(0.0)
        finally:
            self._connection, self._is_ready, self._opening = None, False, None
            connection.close()

    def _expect(self, connection: GuardConnection, *, stops: bool) -> None:
        """Expect an answer to what the guard is asked here."""
        self._answer_due = self._answer_due or time.monotonic() + ANSWER_S
        self._asked_ns = time.monotonic_ns()
        connection.ask_sent(self._asked_number, stops=stops)

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
                if self._unreached is not None and self._command is not None:
                    self._expect(connection, stops=self._is_ready)
            case Lost(why=why):
                self._knows_port, self._answer_due = True, None
                self._is_ready, self._opening = False, None
                self._lose(LinkError(why))
            case Sent(number=number, why=why):
                with self._lock:
                    if number == self._asked_number:
                        self._answer_due, self._unreached = None, f"{self._port}: {why}" if why else None
                    else:  # the answer to a newer question follows
                        self._answer_due = time.monotonic() + ANSWER_S
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
        elif self._is_ready and now_ns - self._heard_ns > self._dialect.silent_s * 1e9:
            self._lose_silent()
        elif (
            self._is_ready
            and self._command is not None
            and now_ns - max(self._heard_ns, self._asked_ns) > self._dialect.silent_s * 5e8
        ):
            self._ask_sent(connection)  # the guard may be frozen

    def _begin(self, connection: GuardConnection, baud: int) -> None:
        if baud != self._baud:
            text = f"the guard of {self._port} runs at {baud} baud, and this driver needs {self._baud}"
            raise LinkError(f"{text}: give all servers of the port the same `baud`, and end them first")
        self._decoder = self._dialect.decoder()
        self._heard_bytes = self._heard_packets = 0
        self._dialect.restart()
        self._is_ready, self._heard_ns = self._command is None, time.monotonic_ns()
        if self._command is not None:
            now_ns = time.monotonic_ns()
            self._opening = OpeningRun(self._dialect.opening(), connection.send, now_ns)
            self._end_opening(now_ns)

    def _end_opening(self, now_ns: int) -> None:
        if self._opening is not None and self._opening.is_done:
            self._opening, self._is_ready, self._heard_ns = None, True, now_ns
            self._note_success()
            if self._unreached is not None and self._connection is not None:
                self._expect(self._connection, stops=True)

    def _lose_silent(self) -> None:
        silence = f"nothing was heard for {self._dialect.silent_s:g} s"
        if self._command is not None:
            raise OpeningError(f"{silence}: the device is opened again")
        self._lose(OpeningError(f"{silence}: does RServer run, whose driver opens the device?"))

    def _hear(self, packet: Packet, t_ns: int) -> None:
        """Take a packet: what it measures, and what it answers."""
        self._heard_ns = t_ns
        self._heard_packets += 1
        if self._opening is not None:
            self._opening.on_packet(packet, time.monotonic_ns())
        try:
            measured_ns = t_ns - self._dialect.delay_ns
            readings = self._dialect.read(packet, measured_ns)
            with self._lock:
                self._measured.take(readings, measured_ns)
        except REFUSALS as problem:
            self._implausible.report("", "", f"a packet was refused: {problem}")
        if self._is_ready:
            self._note_success()

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
