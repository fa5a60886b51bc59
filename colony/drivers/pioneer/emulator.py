"""An emulated Pioneer on a pseudoterminal, with the pace of a serial line.

    python -m colony.drivers.pioneer.emulator --world 4000x6000 --link /tmp/pioneer
    colony serve all --robot pioneer --port /tmp/pioneer

It prints its port, and runs until it is interrupted.
"""

from __future__ import annotations

import argparse
import os
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from colony.drivers.pioneer.firmware import STEP_S, Firmware, Surroundings, open_field, room
from colony.drivers.pioneer.parameters import MODELS

LATEST_S = 0.5
"""The longest time that is caught up with, after which the emulator was held."""


class Emulator:
    """A firmware at the end of a pseudoterminal. Mutable; has a thread, once it is started.

    Args:
        firmware: the robot; while the thread runs, others only read its attributes and press its button.
        baud: the baud rate, which paces both directions.
        clock: the time in seconds.

    Attributes:
        port: the path of the end to open.
    """

    def __init__(
        self, firmware: Firmware, *, baud: int = 9600, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.firmware = firmware
        self._bytes_per_s = baud / 10.0
        self._clock = clock
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(slave)
        os.close(slave)
        self._now = clock()
        self._out, self._in = bytearray(), bytearray()
        self._budget = 0.0
        self._in_budget = 0.0
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
        self._in_budget = (self._in_budget if self._in else 0.0) + self._bytes_per_s * STEP_S
        taken = min(len(self._in), int(self._in_budget))
        self._in_budget -= taken
        self.firmware.receive(bytes(self._in[:taken]))
        del self._in[:taken]
        self.firmware.step()
        for packet in self.firmware.packets():
            if len(self._out) < 2 * 256:  # a line that is too slow loses packets, not bytes of them
                self._out += packet
        self._budget = (self._budget if self._out else 0.0) + self._bytes_per_s * STEP_S
        size = min(len(self._out), int(self._budget))
        if size:
            with suppress(OSError):
                os.write(self._master, self._out[:size])
            self._budget -= size
            del self._out[:size]

    def _run(self) -> None:
        while not self._closed.wait(STEP_S):
            self.catch_up()


def main() -> None:
    """Run an emulator from the command line."""
    parser = argparse.ArgumentParser(prog="python -m colony.drivers.pioneer.emulator", description=_SUMMARY)
    parser.add_argument("--model", choices=sorted(MODELS), default="p3dx-sh", metavar="MODEL")
    parser.add_argument("--baud", type=int, default=9600, help="the baud rate (default: 9600)")
    parser.add_argument("--link", type=Path, help="a symbolic link to the port, so that its name stays")
    parser.add_argument(
        "--world", metavar="WIDTHxDEPTH", help="a room around the robot, in mm; by default none"
    )
    options = parser.parse_args()
    around: Surroundings = open_field
    if options.world is not None:
        try:
            width, depth = map(float, options.world.split("x"))
        except ValueError:
            parser.error(f"--world {options.world}: expected WIDTHxDEPTH in mm, such as 4000x6000")
        around = room(width, depth)
    emulator = Emulator(Firmware(MODELS[options.model], around=around), baud=options.baud)
    if options.link is not None:
        options.link.unlink(missing_ok=True)
        options.link.symlink_to(emulator.port)
    print(options.link or emulator.port, flush=True)
    emulator.start()
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        pass
    finally:
        emulator.close()
        if options.link is not None:
            options.link.unlink(missing_ok=True)


_SUMMARY = "Emulate a Pioneer on a pseudoterminal."

if __name__ == "__main__":
    main()
