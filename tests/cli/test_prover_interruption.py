"""Ctrl-C while z3's Python side is at work."""

from __future__ import annotations

import ctypes
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import pytest

from colony.cli.verify.prover_interruption import interruptions


class Interrupted:
    """An argument in whose conversion Ctrl-C comes."""

    @property
    def _as_parameter_(self) -> int:
        signal.raise_signal(signal.SIGINT)
        return 0


class Deleted:
    """Something in whose deletion Ctrl-C comes: Python forgets what is raised there."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


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


def waits_on(after: Callable[[], object]) -> bool:
    """Whether work after something that lost a Ctrl-C came to its end."""
    ended = False
    with suppress(KeyboardInterrupt), interruptions():
        after()
        for _ in range(10_000):
            time.sleep(0.001)
        ended = True
    return ended


def test_ctrl_c_in_a_deletion_comes_soon_after() -> None:
    assert not waits_on(Deleted)


def test_ctrl_c_in_a_callback_of_c_comes_soon_after() -> None:
    order = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_int), ctypes.POINTER(ctypes.c_int))

    def interrupted(one: object, other: object) -> int:
        signal.raise_signal(signal.SIGINT)
        return 0

    numbers = (ctypes.c_int * 2)(2, 1)
    sort = partial(ctypes.CDLL(None).qsort, numbers, ctypes.c_size_t(2), ctypes.c_size_t(4))
    assert not waits_on(lambda: sort(order(interrupted)))


def test_ctrl_c_in_the_last_deletion_comes_at_the_end() -> None:
    hook = sys.unraisablehook
    with pytest.raises(KeyboardInterrupt), interruptions():
        Deleted()
    assert sys.unraisablehook is hook


def test_what_else_python_forgets_is_told_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: told.append(lost.exc_type))

    class Failing:
        def __del__(self) -> None:
            raise OSError

    with interruptions():
        Failing()
    assert told == [OSError]
