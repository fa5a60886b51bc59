"""An emulated Create 2 on a pseudoterminal, with the pace of its serial line.

    python -m colony.drivers.create2.emulator --room 3000x4000

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

from colony.drivers.create2.firmware import STEP_S, Firmware, World, room

LATEST_S = 0.5
"""The longest time that is caught up with, after which the emulator was held."""


class Emulator:
    """A firmware at the end of a pseudoterminal. Mutable; has a thread, once it is started.

    Args:
        firmware: the robot; while the thread runs, others set its `drops` and `plugged` only.
        baud: the baud rate, which paces both directions.
        clock: the time in seconds.

    Attributes:
        port: the path of the end to open.
    """

    def __init__(
        self, firmware: Firmware, *, baud: int = 115_200, clock: Callable[[], float] = time.monotonic
    ) -> None:
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
        self._in_budget = min(self._in_budget, 16.0) + self._bytes_per_step
        taken = min(len(self._in), int(self._in_budget))
        self._in_budget -= taken
        self.firmware.receive(bytes(self._in[:taken]))
        del self._in[:taken]
        self.firmware.step()
        for data in self.firmware.sent():
            if len(self._out) < 1024:  # a line that is too slow loses whole frames
                self._out += data
        self._out_budget = min(self._out_budget, 16.0) + self._bytes_per_step
        size = min(len(self._out), int(self._out_budget))
        if size:
            with suppress(OSError):
                os.write(self._master, self._out[:size])
            self._out_budget -= size
            del self._out[:size]

    def _run(self) -> None:
        while not self._closed.wait(STEP_S):
            self.catch_up()


def main() -> None:
    """Run an emulator from the command line."""
    parser = argparse.ArgumentParser(description="Emulate a Create 2 on a pseudoterminal.")
    parser.add_argument("--room", metavar="WIDTHxDEPTH", help="a room around the robot, in mm")
    parser.add_argument("--baud", type=int, default=115_200, help="the baud rate (default: 115200)")
    options = parser.parse_args()
    world = World()
    if options.room is not None:
        try:
            width, depth = map(float, options.room.split("x"))
        except ValueError:
            parser.error(f"--room {options.room}: expected WIDTHxDEPTH in mm, such as 3000x4000")
        world = room(width, depth)
    emulator = Emulator(Firmware(world), baud=options.baud)
    print(emulator.port, flush=True)
    emulator.start()
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        pass
    finally:
        emulator.close()


if __name__ == "__main__":
    main()
