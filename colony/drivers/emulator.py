"""Emulated robots on pseudoterminals, with the pace of a serial line; each has a firmware and a command."""

from __future__ import annotations

import argparse
import math
import os
import signal
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Generic, Protocol, TypeVar

# --- surroundings -------------------------------------------------------------------------------------
#
# The plane around an emulated robot: mm, x ahead at the start, y to the left; degrees counterclockwise.

Pose = tuple[float, float, float]
"""A pose: x, y and heading."""

Surroundings = Callable[[float, float, float], float]
"""A function that returns the range in mm from x, y into a direction in degrees; infinite for nothing."""


def open_field(x: float, y: float, bearing: float) -> float:
    """Return infinity: there is nothing."""
    return math.inf


def room(width: float, depth: float) -> Surroundings:
    """Return an empty room around the start, `depth` mm from front to back, `width` from side to side."""

    def range_from(x: float, y: float, bearing: float) -> float:
        ahead, left = math.cos(math.radians(bearing)), math.sin(math.radians(bearing))
        walls = (
            (depth / 2.0 - math.copysign(x, x * ahead), ahead),
            (width / 2.0 - math.copysign(y, y * left), left),
        )
        return max(0.0, min((gap / abs(part) for gap, part in walls if abs(part) > 1e-9), default=math.inf))

    return range_from


def moved(pose: Pose, speed: float, turn: float, time_s: float) -> Pose:
    """Return the pose after `time_s` seconds at `speed` mm/s ahead and `turn` deg/s."""
    x, y, heading = pose
    middle = math.radians(heading + turn * time_s / 2.0)
    return (
        x + speed * time_s * math.cos(middle),
        y + speed * time_s * math.sin(middle),
        heading + turn * time_s,
    )


# --- emulator -----------------------------------------------------------------------------------------

STEP_S = 0.005
"""Seconds of a step of a firmware."""

LATEST_S = 0.5
"""The longest time that is caught up with, after which the emulator was held."""

WAITING_BYTES = 512
"""Bytes that may wait for the line; then it loses packets, but not parts of them."""


class Firmware(Protocol):
    """What runs in a robot: bytes go in and come out, and time passes in steps of `STEP_S`."""

    def receive(self, data: bytes) -> None:
        """Take bytes from the host."""
        ...

    def step(self) -> None:
        """Let one step pass."""
        ...

    def sent(self) -> list[bytes]:
        """Return the packets that are to be sent, oldest first, and forget them."""
        ...


F = TypeVar("F", bound=Firmware)


class Emulator(Generic[F]):
    """A firmware at the end of a pseudoterminal. Mutable; has a thread, once it is started.

    Args:
        firmware: the robot; while the thread runs, others read its attributes, and set what acts on it.
        baud: the baud rate, which paces both directions.
        clock: the time in seconds.
        link: a symbolic link to the port, which stays when the cable is plugged in again.

    Attributes:
        port: the path of the end to open; it changes when the cable is plugged in.
    """

    def __init__(
        self,
        firmware: F,
        *,
        baud: int,
        clock: Callable[[], float] = time.monotonic,
        link: Path | None = None,
    ) -> None:
        self.firmware = firmware
        self._bytes_per_step = baud / 10.0 * STEP_S
        self._clock = clock
        self._link = link
        self._lock = threading.Lock()
        self._master: int | None = None
        self.plug_in()
        self._now = clock()
        self._in, self._out = bytearray(), bytearray()
        self._in_budget = self._out_budget = 0.0
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulator", daemon=True)

    def plug_in(self) -> None:
        """Plug in the cable, unless it is: a new pseudoterminal."""
        if self._master is not None:
            return
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.port = os.ttyname(slave)
        os.close(slave)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(self.port)
            self.port = os.fspath(self._link)
        self._master = master

    def pull_out(self) -> None:
        """Pull out the cable, unless it is: the other end finds the port gone, and the robot goes on."""
        with self._lock:
            master, self._master = self._master, None
        if master is not None:
            if self._link is not None:
                self._link.unlink(missing_ok=True)
            os.close(master)

    def start(self) -> None:
        """Run in a thread from now on."""
        self._thread.start()

    def close(self) -> None:
        """End the thread, if it was started, and pull the cable. Idempotent."""
        if not self._closed.is_set():
            self._closed.set()
            if self._thread.is_alive():
                self._thread.join()
            self.pull_out()

    def catch_up(self) -> None:
        """Let the time pass that the clock says, step by step."""
        now = self._clock()
        self._now = max(self._now, now - LATEST_S)
        self._receive()
        while self._now + STEP_S <= now:
            self._now += STEP_S
            self._step()

    def _step(self) -> None:
        """Let one step pass: the robot, and what the line carries in that time."""
        self._in_budget = (self._in_budget if self._in else 0.0) + self._bytes_per_step
        taken = min(len(self._in), int(self._in_budget))
        self._in_budget -= taken
        self.firmware.receive(bytes(self._in[:taken]))
        del self._in[:taken]
        self.firmware.step()
        for packet in self.firmware.sent():
            if len(self._out) < WAITING_BYTES:
                self._out += packet
        self._out_budget = (self._out_budget if self._out else 0.0) + self._bytes_per_step
        size = min(len(self._out), int(self._out_budget))
        if size:
            self._send(bytes(self._out[:size]))
            self._out_budget -= size
            del self._out[:size]

    def _receive(self) -> None:
        with self._lock, suppress(OSError):  # nobody has the other end open, or there is nothing
            if self._master is None:
                self._in.clear()  # what was on the line is lost
                self._out.clear()
            else:
                self._in += os.read(self._master, 4096)

    def _send(self, data: bytes) -> None:
        with self._lock, suppress(OSError):
            if self._master is not None:
                os.write(self._master, data)

    def _run(self) -> None:
        while not self._closed.wait(STEP_S):
            self.catch_up()


def emulator_options(prog: str, description: str, *, baud: int) -> argparse.ArgumentParser:
    """Return a parser of the options that all commands of emulators have."""
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.add_argument("--baud", type=int, default=baud, help=f"the baud rate (default: {baud})")
    parser.add_argument("--link", type=Path, help="a symbolic link to the port, so that its name stays")
    parser.add_argument(
        "--room",
        type=_room,
        default=open_field,
        metavar="WIDTHxDEPTH",
        help="a room around the robot, in mm, such as 4000x6000; by default none",
    )
    return parser


def run_emulator(emulator: Emulator[F]) -> None:
    """Print the port, and run until SIGINT or SIGTERM; SIGUSR1 pulls out the cable, SIGUSR2 plugs it in."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2)
    signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    emulator.start()
    print(emulator.port, flush=True)
    while (number := signal.sigwait(numbers)) in (signal.SIGUSR1, signal.SIGUSR2):
        emulator.pull_out()
        if number == signal.SIGUSR2:
            emulator.plug_in()
            print(emulator.port, flush=True)
    emulator.close()


def _room(text: str) -> Surroundings:
    try:
        width, depth = map(float, text.split("x"))
        if width > 0.0 and depth > 0.0:
            return room(width, depth)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r}; expected WIDTHxDEPTH in mm, such as 4000x6000")
