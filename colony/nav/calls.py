"""Calls of the navigation scripts to servers that may not be able to answer yet.

A semaphore may be 0, a variable unset, a server unreachable or without a value.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, TypeVar

from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError
from colony.runtime.kit.script import Step, do
from colony.runtime.library import data, robot
from colony.runtime.library.ask import Ask

T = TypeVar("T")

_NOT_YET = ("no value", "unknown", "unset")
"""Refusal codes of servers that have no answer yet."""


def try_wait(semaphore: str, wait_s: float) -> Generator[Step, Any, bool]:
    """Down a semaphore; return False if it stays 0 for `wait_s` seconds.

    Raises:
        CallRefusedError: there is no such semaphore.
    """
    try:
        yield from do("DServer", data.wait(semaphore, timeout_s=wait_s))
    except CallRefusedError as refused:
        if refused.code != "timeout":
            raise
        return False
    return True


def read_variables(*names: str) -> Generator[Step, Any, dict[str, Any] | None]:
    """Return a consistent snapshot of variables, or None if one of them was never set."""
    try:
        return (yield from do("DServer", data.get_many(names)))
    except CallRefusedError as refused:
        if refused.code not in ("unknown", "unset"):
            raise
        return None


def try_ask(server: str, ask: Ask[T]) -> Generator[Step, Any, T | None]:
    """Return a server's answer, or None while the server is unreachable or has no value yet.

    Raises:
        CallRefusedError: the server refuses the request, and always will.
    """
    try:
        return (yield from do(server, ask))
    except RobotConnectionError as problem:
        _raise_if_final(problem)
        return None


def try_adjust_position(x_mm: float, y_mm: float, turn_deg: float) -> Generator[Step, Any, bool]:
    """Correct RServer's position; return False if RServer is unreachable.

    Raises:
        CallRefusedError: RServer refuses the correction, and always will.
    """
    try:
        yield from do("RServer", robot.adjust_position(x_mm, y_mm, turn_deg))
    except RobotConnectionError as problem:
        _raise_if_final(problem)
        return False
    return True


def _raise_if_final(problem: RobotConnectionError) -> None:
    """Raise a final refusal; ignore other connection problems, as a dead server is restarted."""
    if isinstance(problem, CallRefusedError) and problem.code not in _NOT_YET:
        raise problem
