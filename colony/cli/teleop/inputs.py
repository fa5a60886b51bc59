"""What an operator's hand asks for, at a gamepad or at the keys of a terminal.

Both are read without blocking. Each gives a `Hand` only while the operator holds it: by the deadman of the
gamepad, or by a key. A terminal reports no releases, so a key counts as held for a while after it was pressed
or has repeated.
"""

from __future__ import annotations

import math
import os
import re
import signal
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Literal, NamedTuple

from colony.cli.interruption import termination_signals
from colony.drivers.gamepad import AxisPart, Gamepad

HOLD_S = 0.6
"""Seconds for which a key counts as held until it repeats: most terminals take 0.25 to 0.5 s."""

REPEAT_S = 0.2
"""Seconds for which a key that repeats counts as held; terminals repeat it every 20 to 100 ms."""

Wish = Literal["", "stop", "quit"]
"""A request of an operator besides motion: an emergency stop, or the end; "" for none."""


class Hand(NamedTuple):
    """What is asked for, as parts of full speeds in [-1, 1]; positive is ahead, and to the left."""

    velocity: float
    turn: float
    sideways: float
    fast: bool = False


# --- gamepad ---------------------------------------------------------------------------------------------


class PadLayout(NamedTuple):
    """The buttons and axes of a gamepad that count, and the part of an axis around its middle that is 0."""

    deadman: int
    fast: int
    stop: int
    velocity: AxisPart
    turn: AxisPart
    sideways: AxisPart
    dead_zone: float


class GamepadInput:
    """A gamepad, held by its deadman. Mutable: its state.

    `holds_s` is the time in seconds after which what is held counts as released by itself: never.
    """

    def __init__(self, pad: Gamepad, layout: PadLayout) -> None:
        self._pad, self._layout = pad, layout
        self.fileno = pad.fileno

    @property
    def problem(self) -> str:
        """Why the gamepad cannot be read; "" while it can."""
        return self._pad.problem

    def read(self, now_s: float) -> Wish:
        """Take its events; a gamepad that is gone is released, and looked for."""
        return "stop" if self._layout.stop in self._pad.read(now_s) else ""

    def hand(self, now_s: float) -> Hand | None:
        """Return what its axes ask for while the deadman is held."""
        pad, layout = self._pad, self._layout
        if layout.deadman not in pad.pressed:
            return None
        velocity, turn, sideways = (
            axis.factor * pad.axis(axis.code, layout.dead_zone)
            for axis in (layout.velocity, layout.turn, layout.sideways)
        )
        return Hand(velocity, turn, sideways, layout.fast in pad.pressed)

    def holds_s(self, now_s: float) -> float:
        """Return infinity: the deadman is held until it is released."""
        return math.inf

    def release(self) -> None:
        """Count the deadman as released, until it is pressed again."""
        self._pad.pressed.discard(self._layout.deadman)


# --- keyboard --------------------------------------------------------------------------------------------

_AHEAD, _BACK = Hand(1.0, 0.0, 0.0), Hand(-1.0, 0.0, 0.0)
_LEFT, _RIGHT = Hand(0.0, 1.0, 0.0), Hand(0.0, -1.0, 0.0)
_LETTERS = {"w": _AHEAD, "s": _BACK, "a": _LEFT, "d": _RIGHT}
_OTHERS = {",": Hand(0.0, 0.0, 1.0), ".": Hand(0.0, 0.0, -1.0)}
_ARROWS = {"A": _AHEAD, "B": _BACK, "C": _RIGHT, "D": _LEFT}

_KEY = re.compile(r"\x1b[\[O][0-9;]*([A-Za-z~])|([^\x1b])")
_CUT_OFF = re.compile(r"\x1b(?:[\[O][0-9;]*)?\Z")
"""The beginning of the sequence of an arrow, the rest of which comes later."""


class Keyboard:
    """The keys of a terminal. Mutable: the key that is held.

    One key counts at a time; one without a meaning, such as the space bar, releases the one that is held.
    """

    problem = ""

    def __init__(self, file: int) -> None:
        self._file = file
        self._rest = ""
        self._held: Hand | None = None
        self._until_s = 0.0

    def fileno(self) -> int | None:
        """Return the descriptor of the terminal."""
        return self._file

    def read(self, now_s: float) -> Wish:
        """Take the keys that were pressed."""
        data = b""
        with suppress(OSError):  # the terminal was closed
            data = os.read(self._file, 4096)
        if not data:
            return "quit"
        text = self._rest + data.decode("latin-1")
        cut_off = _CUT_OFF.search(text)
        self._rest = "" if cut_off is None else cut_off[0]
        if self._rest:  # Escape, unless the rest of an arrow follows
            self.release()
        for arrow, key in _KEY.findall(text.removesuffix(self._rest)):
            if key.lower() in ("q", "x"):
                self.release()
                return "quit" if key.lower() == "q" else "stop"
            hand = _ARROWS.get(arrow) or _OTHERS.get(key) or _LETTERS.get(key.lower())
            hand = hand and hand._replace(fast=key.isupper())
            self._until_s = now_s + (REPEAT_S if hand == self.hand(now_s) else HOLD_S)
            self._held = hand
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


@contextmanager
def single_keys(file: int) -> Iterator[None]:
    """Have a terminal hand over each key at once, without showing it, as long as the context lasts.

    Signals that end a process raise KeyboardInterrupt from here on, so that the context ends.
    """
    before = termios.tcgetattr(file)
    for number in (*termination_signals(), signal.SIGQUIT):
        signal.signal(number, signal.default_int_handler)
    try:
        tty.setcbreak(file)
        yield
    finally:
        with suppress(termios.error):  # the terminal was closed
            termios.tcsetattr(file, termios.TCSAFLUSH, before)
