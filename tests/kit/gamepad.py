"""A gamepad for tests: a pipe with the bytes of input events, which is opened as a device is."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from colony.drivers.gamepad import AXES, BUTTONS

EVENT = struct.Struct("@llHHi")
"""`struct input_event` of Linux: seconds, microseconds, type, code, value."""

SYN_REPORT = EVENT.pack(0, 0, 0, 0, 0)
SYN_DROPPED = EVENT.pack(0, 0, 0, 3, 0)
FULL = 32767


def key(name: str, value: int) -> bytes:
    """Return the event of a button: 1 pressed, 0 released, 2 repeated."""
    return EVENT.pack(1, 500_000, 1, BUTTONS[name], value)


def axis(name: str, value: int) -> bytes:
    """Return the event of an axis."""
    return EVENT.pack(1, 500_000, 3, AXES[name], value)


class Pad:
    """The hand's end of a pipe. Mutable: unplugged or not."""

    def __init__(self, path: Path) -> None:
        self.path = path
        os.mkfifo(path)
        self._file = os.open(path, os.O_RDWR)  # opening it for writing alone would wait for a reader

    def send(self, *events: bytes) -> None:
        """Send events, and the report that ends them."""
        os.write(self._file, b"".join((*events, SYN_REPORT)))

    def press(self, *names: str) -> None:
        self.send(*(key(name, 1) for name in names))

    def release(self, *names: str) -> None:
        self.send(*(key(name, 0) for name in names))

    def move(self, **axes: float) -> None:
        """Move axes, in parts of their way: -1 to 1."""
        self.send(*(axis(name, round(part * FULL)) for name, part in axes.items()))

    def unplug(self) -> None:
        """The end of the pipe, as of a device that is gone. Idempotent."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def plug(self) -> None:
        """Plug it in again."""
        self._file = os.open(self.path, os.O_RDWR)


@contextmanager
def pad(folder: Path) -> Iterator[Pad]:
    """A gamepad, at `folder/pad`."""
    made = Pad(folder / "pad")
    try:
        yield made
    finally:
        made.unplug()
