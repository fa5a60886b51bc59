"""Ctrl-C while z3's Python side is at work."""

from __future__ import annotations

import ctypes
import signal

import pytest

from colony.cli.verify_interruption import interruptions


class Interrupted:
    """An argument in whose conversion Ctrl-C comes."""

    @property
    def _as_parameter_(self) -> int:
        signal.raise_signal(signal.SIGINT)
        return 0


class Wrong:
    """An argument that C cannot take."""


def absolute() -> ctypes._NamedFuncPointer:
    function = ctypes.CDLL(None).abs
    function.argtypes = [ctypes.c_int]
    return function


def test_ctrl_c_in_a_conversion_is_a_keyboard_interrupt() -> None:
    with pytest.raises(ctypes.ArgumentError, match="KeyboardInterrupt"):
        absolute()(Interrupted())
    with pytest.raises(KeyboardInterrupt), interruptions():
        absolute()(Interrupted())


def test_other_wrong_arguments_stay_what_they_are() -> None:
    with pytest.raises(ctypes.ArgumentError), interruptions():
        absolute()(Wrong())
