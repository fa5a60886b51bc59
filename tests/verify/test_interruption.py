"""Ctrl-C while z3's Python side is at work."""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import pytest
import z3

from colony.verify.interruption import reliable_interrupts


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


class DeletedByC:
    """Something whose deletion is a call of C, in whose conversion Ctrl-C comes."""

    def __del__(self) -> None:
        absolute()(Interrupted())


class Wrong:
    """An argument that C cannot take."""


def absolute() -> ctypes._NamedFuncPointer:
    function = ctypes.CDLL(None).abs
    function.argtypes = [ctypes.c_int]
    return function


def test_ctrl_c_in_a_conversion_is_a_keyboard_interrupt() -> None:
    with pytest.raises(ctypes.ArgumentError, match="KeyboardInterrupt"):
        absolute()(Interrupted())
    with pytest.raises(KeyboardInterrupt), reliable_interrupts():
        absolute()(Interrupted())


def test_half_made_objects_of_z3_are_deleted_without_a_word(
    capfd: pytest.CaptureFixture[str],
) -> None:
    def make() -> None:
        made = z3.BoolRef.__new__(z3.BoolRef)
        signal.raise_signal(signal.SIGINT)
        del made

    with pytest.raises(KeyboardInterrupt), reliable_interrupts():
        make()
    assert capfd.readouterr().err == ""


def test_other_wrong_arguments_stay_what_they_are() -> None:
    with pytest.raises(ctypes.ArgumentError), reliable_interrupts():
        absolute()(Wrong())


def waits_on(after: Callable[[], object]) -> bool:
    """Whether work after something that lost a Ctrl-C came to its end."""
    ended = False
    with suppress(KeyboardInterrupt), reliable_interrupts():
        after()
        for _ in range(10_000):
            time.sleep(0.001)
        ended = True
    return ended


def test_ctrl_c_in_a_deletion_comes_soon_after() -> None:
    assert not waits_on(Deleted)


def test_ctrl_c_in_a_conversion_of_a_deletion_comes_soon_after() -> None:
    assert not waits_on(DeletedByC)


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
    with pytest.raises(KeyboardInterrupt), reliable_interrupts():
        Deleted()
    assert sys.unraisablehook is hook


def test_what_else_python_forgets_is_told_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: told.append(lost.exc_type))

    class Failing:
        def __del__(self) -> None:
            raise OSError

    with reliable_interrupts():
        Failing()
    assert told == [OSError]


class CheckedOnDeletion:
    """A query that goes on for long, and that Ctrl-C ends in a deletion, where it is lost."""

    def __del__(self) -> None:
        x, y, z = z3.Ints("x y z")
        ctrl_c = threading.Timer(0.1, signal.raise_signal, [signal.SIGINT])
        ctrl_c.start()
        solver = z3.Solver()
        solver.add(x * x * x + y * y * y + z * z * z == 114)
        solver.check()


def test_what_z3_cancels_is_a_keyboard_interrupt_after_ctrl_c_alone() -> None:
    def cancel() -> None:
        CheckedOnDeletion()
        raise z3.Z3Exception(b"push canceled")

    with pytest.raises(KeyboardInterrupt), reliable_interrupts():
        cancel()
    with pytest.raises(z3.Z3Exception, match="canceled"), reliable_interrupts():
        raise z3.Z3Exception(b"push canceled")


def answers(seconds: float, ask: Callable[[z3.Solver], object]) -> bool:
    """Ask z3 until Ctrl-C comes; return False if that went on for a minute."""
    ctrl_c = threading.Timer(seconds, signal.raise_signal, [signal.SIGINT])
    end = time.monotonic() + 60
    with suppress(KeyboardInterrupt), reliable_interrupts():
        solver = z3.Solver()
        solver.push()
        ctrl_c.start()
        while time.monotonic() < end:
            ask(solver)
    ctrl_c.join()
    return time.monotonic() < end


def quick(solver: z3.Solver) -> None:
    solver.push()
    solver.add(z3.Int("a") * 2 > z3.Int("b"))
    solver.check()
    solver.pop()


def endless(solver: z3.Solver) -> None:
    a, b, c = z3.Ints("a b c")
    solver.add(a * a * a + b * b * b + c * c * c == 114)
    solver.check()


@pytest.mark.parametrize("k", range(10))
def test_ctrl_c_between_and_in_quick_answers_of_z3(k: int) -> None:
    """With z3's own handler one in four was forgotten, as it came just when there was an answer."""
    assert answers(0.05 + 0.003 * k, quick)


def test_ctrl_c_ends_what_z3_never_answers() -> None:
    assert answers(0.5, endless)
    assert z3.Solver().check() == z3.sat  # later questions are answered
