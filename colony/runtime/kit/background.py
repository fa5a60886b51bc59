"""A device that blocks, in threads of its own, as a driver for a server, which never waits for it.

    class Port(BlockingDevice):
        def __init__(self, port: str) -> None:
            self._serial = serial.Serial(port, 115200)

        def read(self) -> dict[str, float]:
            return {"level": float(self._serial.readline())}

        def close(self) -> None:
            self._serial.close()

    def battery(port: str) -> Background:
        return Background(lambda: Port(port), delay_ns=5_000_000)

One thread opens the device and reads it, again after increasing pauses when it fails; another sends it
commands. The driver gives the newest readings with their ages. Whatever the device raises is reported, and
ends its readings until it works again. A device that blocks for ever keeps its threads waiting, and nothing
else: its readings get older, and its commands count as not sent.
"""

from __future__ import annotations

import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress

from colony.backoff import Backoff
from colony.ir.types import ScalarValue, Value
from colony.runtime.kit.once import OnceReporter, Report, exception_text, failure_text
from colony.runtime.servers.drivers import Reading

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 5.0
"""Seconds before the device is opened again: after the first failure, and at most."""

STABLE_S = 5.0
"""Seconds that a device has to work before its next failure counts as a first one."""

STUCK_S = 1.0
"""Seconds that a device may take for a command, before the next ones count as not sent."""

CLOSE_S = 0.4
"""Seconds that each thread has to end when the driver is closed."""


class BlockingDevice(ABC):
    """A device whose methods may block and raise. Opened by the function that makes it.

    `read` runs in one thread, `command` and `safe` in another; `close` may be called by either, while the
    other is still in the device, and should end its wait.
    """

    @abstractmethod
    def read(self) -> Mapping[str, Value | tuple[ScalarValue | None, ...]] | None:
        """Wait for the next measurement, and return the fields that it has; None for nothing new."""

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Send a command, with its parameters by name."""
        raise ValueError(f"the device has no command `{name}`")

    def safe(self) -> None:  # noqa: B027  # a device without commands is always safe
        """Make the device safe; also called by the first thread whenever it has opened the device."""

    def close(self) -> None:  # noqa: B027  # a device may have nothing to release
        """Release the device."""


class DeviceBackoff(Backoff[float]):
    """The pauses in seconds between the failures of a device and its next openings. Mutable."""

    def __init__(self) -> None:
        super().__init__(FIRST_PAUSE_S, LONGEST_PAUSE_S)

    def after(self, worked_s: float) -> float:
        """Return the pause after a failure of a device that had worked for so many seconds."""
        if worked_s >= STABLE_S:
            self.reset()
        return self.next()


def _to_stderr(problem: str) -> None:
    print(problem, file=sys.stderr, flush=True)


class Background:
    """A driver over a device that blocks. Mutable; shared by its threads and the server's.

    Args:
        make: opens the device; called in a thread, again after each failure.
        delay_ns: the age of a measurement when `read` returns it.
        report: takes each problem of the device once in each outage, and the end of the outage; called from
            other threads.
        clock: the monotonic clock in nanoseconds.
    """

    def __init__(
        self,
        make: Callable[[], BlockingDevice],
        *,
        delay_ns: int = 0,
        report: Report = _to_stderr,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._make = make
        self._delay_ns = delay_ns
        self._report = report
        self._problems: OnceReporter | None = None
        self._clock = clock
        self._changed = threading.Condition()
        self._closed = threading.Event()
        self._device: BlockingDevice | None = None
        self._lost: BlockingDevice | None = None
        self._newest: dict[str, tuple[Value | tuple[ScalarValue | None, ...], int]] = {}
        self._problem = "it is not open yet"
        self._safe_due = self._safe_missed = False
        self._commands: dict[str, Mapping[str, ScalarValue]] = {}
        self._sending_since_ns: int | None = None
        self._threads = [
            threading.Thread(target=target, name=f"device {name}", daemon=True)
            for target, name in ((self._run_reader, "reader"), (self._run_writer, "writer"))
        ]
        for thread in self._threads:
            thread.start()

    # --- the driver, called by the server ------------------------------------------------------------

    @property
    def problem(self) -> str | None:
        """Why the device does not work, from its first failure until it works again; else None."""
        return None if self._problems is None else self._problem

    @property
    def is_opening(self) -> bool:
        """True until the device is open for the first time, or fails to open."""
        return self._device is None and self._problems is None

    @property
    def unreached(self) -> str | None:
        """Why the device has not taken the last command, or `safe`, or not yet; None once it has."""
        with self._changed:
            if self._safe_missed:
                return f"the device does not work: {self._problem}"
            is_pending = self._safe_due or self._commands or self._sending_since_ns is not None
            return "the device has not taken what it was sent" if is_pending else None

    def fields(self) -> Mapping[str, Reading | None]:
        """Return the newest readings with their ages; none while the device does not work."""
        with self._changed:
            newest, now_ns = dict(self._newest), self._clock()
        return {
            name: Reading(value, max(0, now_ns - arrived_ns) + self._delay_ns)
            for name, (value, arrived_ns) in newest.items()
        }

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Have a command sent as soon as the device takes it; a newer one of this name replaces it.

        Raises:
            ConnectionError: the device does not work.
            TimeoutError: it has not taken the last command yet.
        """
        with self._changed:
            if self._device is None:
                raise ConnectionError(f"the device does not work: {self._problem}")
            since_ns = self._sending_since_ns
            if since_ns is not None and self._clock() - since_ns > STUCK_S * 1e9:
                raise TimeoutError(f"the device has not taken the last command in {STUCK_S:g} s")
            self._commands[name] = dict(values)
            self._changed.notify_all()

    def safe(self) -> None:
        """Have the device made safe, in place of the commands that were not sent yet."""
        with self._changed:
            self._commands.clear()
            self._safe_due = self._device is not None  # one that is opened later is made safe then
            self._safe_missed = self._device is None
            self._changed.notify_all()

    def close(self) -> None:
        """Send what is left, and release the device. Idempotent."""
        self._closed.set()
        with self._changed:
            self._changed.notify_all()
        reader, writer = self._threads
        writer.join(CLOSE_S)
        device = self._device
        self._lose(device, None)
        reader.join(CLOSE_S)

    # --- the threads ---------------------------------------------------------------------------------

    def _run_reader(self) -> None:
        pauses = DeviceBackoff()
        while not self._closed.is_set():
            device, began_ns = None, self._clock()
            try:
                device = self._make()
                device.safe()
                if self._adopt(device):
                    self._read(device)
            except (Exception, SystemExit) as problem:
                self._lose(device, problem)
            self._closed.wait(pauses.after((self._clock() - began_ns) / 1e9))

    def _adopt(self, device: BlockingDevice) -> bool:
        """Take commands for a device from now on; False, and release it, if the driver is closed already."""
        with self._changed:
            if not self._closed.is_set():
                self._device, self._safe_missed = device, False
                return True
        device.close()
        return False

    def _read(self, device: BlockingDevice) -> None:
        """Read a device until it is lost."""
        while self._device is device:
            found = device.read()
            arrived_ns = self._clock()
            if found is None:
                continue
            readings = {name: (value, arrived_ns) for name, value in found.items()}
            with self._changed:
                if self._device is not device:
                    return
                self._newest.update(readings)
            self._note_success(device)

    def _run_writer(self) -> None:
        while (due := self._next_due()) is not None:
            device, is_safe, commands = due
            try:
                if is_safe:
                    device.safe()
                for name, values in commands.items():
                    if self._safe_due:  # in place of what was not sent yet
                        break
                    device.command(name, values)
                    self._note_success(device)
            except (Exception, SystemExit) as problem:
                self._lose(device, problem)
            with self._changed:
                self._sending_since_ns = None

    def _next_due(self) -> tuple[BlockingDevice, bool, dict[str, Mapping[str, ScalarValue]]] | None:
        """Wait for what is to be sent, and return it; None once the driver is closed and nothing is left."""
        with self._changed:
            while True:
                self._changed.wait_for(lambda: self._safe_due or self._commands or self._closed.is_set())
                is_safe, commands = self._safe_due, self._commands
                self._safe_due, self._commands = False, {}
                if self._device is not None and (is_safe or commands):
                    self._sending_since_ns = self._clock()
                    return self._device, is_safe, commands
                if self._closed.is_set():
                    return None

    def _note_success(self, device: BlockingDevice) -> None:
        """End an outage, unless the device was lost meanwhile."""
        with self._changed:
            if self._problems is None or self._device is not device:
                return
            self._problems = None
        self._report("the device works again")

    def _lose(self, device: BlockingDevice | None, problem: BaseException | None) -> None:
        """Release a device, forget what it read, and report the problem that it had."""
        if device is not None:
            with self._changed:
                if device is self._lost:
                    return  # the other thread found the problem first, and released it
                self._lost = device
                if device is self._device:
                    self._safe_missed = self._safe_due or self._sending_since_ns is not None
                    self._device, self._newest, self._commands = None, {}, {}
            with suppress(Exception):
                device.close()
        if problem is None or self._closed.is_set():
            return
        kind = type(problem).__name__
        self._problem = f"{kind}: {exception_text(problem)}"
        with self._changed:
            problems = self._problems = self._problems or OnceReporter(self._report)
        problems.report("", kind, failure_text("the device, which is opened again,", problem))
