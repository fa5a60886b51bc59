"""Emulated robots on pseudoterminals, with the pace of a serial line; each has a firmware and a command."""

from __future__ import annotations

import argparse
import os
import signal
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from colony.drivers.surroundings import Surroundings, open_field, room

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

    Attributes:
        port: the path of the end to open.
    """

    def __init__(self, firmware: F, *, baud: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.firmware = firmware
        self._bytes_per_step = baud / 10.0 * STEP_S
        self._clock = clock
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(slave)
        os.close(slave)
        self._now = clock()
        self._in, self._out = bytearray(), bytearray()
        self._in_budget = self._out_budget = 0.0
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulator", daemon=True)

    def start(self) -> None:
        """Run in a thread from now on."""
        self._thread.start()

    def close(self) -> None:
        """End the thread, if it was started, and pull the cable. Idempotent."""
        if not self._closed.is_set():
            self._closed.set()
            if self._thread.is_alive():
                self._thread.join()
            os.close(self._master)

    def catch_up(self) -> None:
        """Let the time pass that the clock says, step by step."""
        now = self._clock()
        self._now = max(self._now, now - LATEST_S)
        with suppress(OSError):  # nobody has the other end open, or there is nothing
            self._in += os.read(self._master, 4096)
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
            with suppress(OSError):
                os.write(self._master, self._out[:size])
            self._out_budget -= size
            del self._out[:size]

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


def run_emulator(emulator: Emulator[F], link: Path | None) -> None:
    """Print the port, and run until SIGINT or SIGTERM."""
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    if link is not None:
        link.unlink(missing_ok=True)
        link.symlink_to(emulator.port)
    print(link or emulator.port, flush=True)
    emulator.start()
    try:
        ending.wait()
    finally:
        emulator.close()
        if link is not None:
            link.unlink(missing_ok=True)


def _room(text: str) -> Surroundings:
    try:
        width, depth = map(float, text.split("x"))
        if width > 0.0 and depth > 0.0:
            return room(width, depth)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r}; expected WIDTHxDEPTH in mm, such as 4000x6000")
