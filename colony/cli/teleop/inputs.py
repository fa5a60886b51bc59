"""What an operator's hand asks for, at a gamepad or at the keys of a terminal.

Both are read without blocking. Each gives a `Hand` only while the operator holds it: by the deadman of the
gamepad, or by a key. A terminal reports no releases, so a key counts as held for a while after it was pressed
or has repeated.
"""

from __future__ import annotations

import math
import os
import re
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Literal, NamedTuple, Protocol

from colony.drivers.gamepad import AxisPart, Gamepad, GamepadError, beyond, open_gamepad

REPEAT_S = 0.2
"""Seconds for which a key that repeats counts as held; terminals repeat it every 20 to 100 ms."""

Wish = Literal["", "stop", "quit"]
"""What an operator asks for besides motion: an emergency stop, or the end."""


class Hand(NamedTuple):
    """What is asked for, as parts of full speeds in [-1, 1]; positive is ahead, and to the left."""

    velocity: float
    turn: float
    sideways: float
    fast: bool = False


class HandInput(Protocol):
    """A device at an operator's hand."""

    problem: str

    def fileno(self) -> int | None:
        """Return the descriptor that becomes readable; None while the device is gone."""
        ...

    def read(self, now_s: float) -> Wish:
        """Read what is there."""
        ...

    def hand(self, now_s: float) -> Hand | None:
        """Return what is asked for now; None if nothing is held."""
        ...

    def holds_s(self, now_s: float) -> float:
        """Return the seconds after which what is held now counts as released by itself."""
        ...

    def release(self) -> None:
        """Count as released, until something is pressed."""
        ...

    def reopen(self) -> None:
        """Look for a device that is gone."""
        ...


# --- gamepad ---------------------------------------------------------------------------------------------


class Layout(NamedTuple):
    """The buttons and axes of a gamepad that count, and the part of an axis around its middle that is 0."""

    deadman: int
    fast: int
    stop: int
    velocity: AxisPart
    turn: AxisPart
    sideways: AxisPart
    dead_zone: float


class GamepadInput:
    """A gamepad: it is held by its deadman. Mutable: has the device.

    Raises:
        GamepadError: there is no gamepad.
    """

    def __init__(self, device: str, layout: Layout) -> None:
        self._device, self._layout = device, layout
        self._pad: Gamepad | None = open_gamepad(device)
        self.problem = ""

    def fileno(self) -> int | None:
        """Return the descriptor of the gamepad; None while it is gone."""
        return None if self._pad is None else self._pad.fileno()

    def read(self, now_s: float) -> Wish:
        """Take its events; a gamepad that is gone is released."""
        try:
            clicked = () if self._pad is None else self._pad.read()
        except OSError:
            self.close()
            self.problem = "the gamepad is gone"
            return ""
        return "stop" if self._layout.stop in clicked else ""

    def hand(self, now_s: float) -> Hand | None:
        """Return what its axes ask for while the deadman is held."""
        pad, layout = self._pad, self._layout
        if pad is None or layout.deadman not in pad.pressed:
            return None

        def part(axis: AxisPart) -> float:
            return axis.factor * beyond(pad.axis(axis.code), layout.dead_zone)

        is_fast = layout.fast in pad.pressed
        return Hand(part(layout.velocity), part(layout.turn), part(layout.sideways), is_fast)

    def holds_s(self, now_s: float) -> float:
        """Return infinity: the deadman is held until it is released."""
        return math.inf

    def release(self) -> None:
        """Count the deadman as released, until it is pressed again."""
        if self._pad is not None:
            self._pad.pressed.discard(self._layout.deadman)

    def reopen(self) -> None:
        """Open the gamepad again, if it is back."""
        with suppress(GamepadError):
            self._pad, self.problem = open_gamepad(self._device), ""

    def close(self) -> None:
        """Close the gamepad."""
        if self._pad is not None:
            self._pad.close()
            self._pad = None


# --- keyboard --------------------------------------------------------------------------------------------

_AHEAD, _BACK = Hand(1.0, 0.0, 0.0), Hand(-1.0, 0.0, 0.0)
_LEFT, _RIGHT = Hand(0.0, 1.0, 0.0), Hand(0.0, -1.0, 0.0)

_MOTIONS = {
    "w": _AHEAD,
    "up": _AHEAD,
    "s": _BACK,
    "down": _BACK,
    "a": _LEFT,
    "left": _LEFT,
    "d": _RIGHT,
    "right": _RIGHT,
    ",": Hand(0.0, 0.0, 1.0),
    ".": Hand(0.0, 0.0, -1.0),
}
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}

_KEY = re.compile(rb"\x1b[\[O]([0-9;]*)([A-Za-z~])|([^\x1b])")
_CUT_OFF = re.compile(rb"\x1b(?:[\[O][0-9;]*)?\Z")


class Keyboard:
    """The keys of a terminal. Mutable: the key that is held.

    Any other key, such as the space bar, releases the one that is held.

    Args:
        file: the descriptor of the terminal.
        hold_s: seconds for which a key counts as held until it repeats.
    """

    problem = ""

    def __init__(self, file: int, hold_s: float) -> None:
        self._file, self._hold_s = file, hold_s
        self._rest = b""
        self._held: Hand | None = None
        self._until_s = 0.0

    def fileno(self) -> int | None:
        """Return the descriptor of the terminal."""
        return self._file

    def read(self, now_s: float) -> Wish:
        """Take the keys that were pressed."""
        try:
            data = os.read(self._file, 4096)
        except OSError:  # the terminal was closed
            data = b""
        if not data:
            return "quit"
        for key in self._keys(data):
            if key in ("q", "Q"):
                return "quit"
            if key in ("x", "X"):
                self.release()
                return "stop"
            self._press(_MOTIONS.get(key.lower()), key.isupper(), now_s)
        return ""

    def hand(self, now_s: float) -> Hand | None:
        """Return what the key asks for that counts as held."""
        return self._held if now_s < self._until_s else None

    def holds_s(self, now_s: float) -> float:
        """Return the seconds until the key counts as released."""
        return max(self._until_s - now_s, 0.0)

    def release(self) -> None:
        """Count every key as released."""
        self._held = None

    def reopen(self) -> None:
        """Do nothing: a terminal that is gone does not come back."""

    def _press(self, motion: Hand | None, is_fast: bool, now_s: float) -> None:
        hand = None if motion is None else motion._replace(fast=is_fast)
        repeats = hand is not None and hand == self.hand(now_s)
        self._held, self._until_s = hand, now_s + (min(REPEAT_S, self._hold_s) if repeats else self._hold_s)

    def _keys(self, data: bytes) -> Iterator[str]:
        """Yield keys; arrows come as sequences, which may arrive in two parts."""
        data = self._rest + data
        cut_off = _CUT_OFF.search(data)
        self._rest = data[cut_off.start() :] if cut_off is not None else b""
        for match in _KEY.finditer(data, 0, len(data) - len(self._rest)):
            if match[3] is not None:
                yield match[3].decode("latin-1")
            elif match[2] is not None:
                yield _ARROWS.get(match[2].decode(), "")


@contextmanager
def single_keys(file: int) -> Iterator[None]:
    """Have a terminal hand over each key at once, without showing it, as long as the context lasts."""
    before = termios.tcgetattr(file)
    try:
        tty.setcbreak(file)
        yield
    finally:
        with suppress(termios.error):  # the terminal was closed
            termios.tcsetattr(file, termios.TCSAFLUSH, before)
