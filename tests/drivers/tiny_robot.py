"""A robot of the tiny protocol on a pseudoterminal: answers, measures, and notes what it hears and when."""

from __future__ import annotations

import errno
import os
import select
import struct
import threading
import time
import tty
from pathlib import Path

from tests.drivers.tiny import GOODBYE, HELLO, JAW, SPEEDS, decoder, encoded

PERIOD_S = 0.02


class TinyRobot:
    """The robot. Its port is a link that stays, while pseudoterminals come and go. Mutable; has a thread."""

    def __init__(self, port: Path) -> None:
        self.port, self._link = str(port), port
        self.heard: list[tuple[bytes, float]] = []  # data of frames, `time.monotonic`
        self.speeds = (0, 0)
        self.jaw = 0
        self.is_on = self.greets = True
        self._master = -1
        self._plugged = threading.Event()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.plug_in()
        self._thread.start()

    def plug_in(self) -> None:
        """Connect the robot."""
        self._master, slave = os.openpty()
        tty.setraw(slave)
        name = os.ttyname(slave)
        os.close(slave)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(name)
        self._plugged.set()

    def pull_out(self) -> None:
        """Pull the cable: the other end finds the port gone."""
        self._plugged.clear()
        self._link.unlink()
        os.close(self._master)

    def close(self) -> None:
        """End the robot."""
        self._closed.set()
        self._thread.join()
        if self._plugged.is_set():
            os.close(self._master)

    def write(self, data: bytes) -> None:
        """Send bytes, of which it sends nothing else in the middle."""
        os.write(self._master, data)

    def count(self, kind: int) -> int:
        """Return how many frames of a kind were heard."""
        return sum(data[0] == kind for data, _ in self.heard)

    def _run(self) -> None:
        reader, x, due = decoder(), 0, 0.0
        while not self._closed.is_set():
            if not self._plugged.wait(0.01):
                reader = decoder()
                continue
            try:
                if select.select([self._master], [], [], PERIOD_S)[0]:
                    for data in reader.feed(os.read(self._master, 4096)):
                        self._hear(data)
                if self.is_on and (now := time.monotonic()) >= due:
                    due = now + PERIOD_S
                    x += round(self.speeds[0] * PERIOD_S)
                    self._send(x)
            except OSError as problem:
                if problem.errno not in (errno.EIO, errno.EBADF):
                    raise
                time.sleep(0.005)  # nobody has the other end open, or the cable was pulled

    def _hear(self, data: bytes) -> None:
        if not self.is_on:
            return
        self.heard.append((data, time.monotonic()))
        if data[0] == SPEEDS:
            self.speeds = struct.unpack_from("<hh", data, 1)
        elif data[0] == JAW:
            (self.jaw,) = struct.unpack_from("<b", data, 1)
        elif data[0] == HELLO and self.greets:
            os.write(self._master, encoded(bytes([4])))
        elif data[0] == GOODBYE:
            self.speeds = (0, 0)

    def _send(self, x: int) -> None:
        frames = [struct.pack("<BhhH", 1, (x + 32768) % 65536 - 32768, 0, 9000), bytes([2, 124])]
        frames += [struct.pack("<BBH", 3, i, 1000 + i) for i in range(4)]
        os.write(self._master, b"".join(map(encoded, frames)))
