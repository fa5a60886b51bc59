"""Requests that the navigation scripts make of DServer and of other servers.

Semaphores may be 0, variables may be unset, and a server may not know the answer yet.
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
"""Codes of servers that have no answer yet."""


def taken(semaphore: str, wait_s: float) -> Generator[Step, Any, bool]:
    """Down a semaphore; return False if it stays 0 for so many seconds, 0 for no waiting.

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


def values(*names: str) -> Generator[Step, Any, dict[str, Any] | None]:
    """Return variables at one moment, or None if one of them was never set."""
    try:
        return (yield from do("DServer", data.get_many(names)))
    except CallRefusedError as refused:
        if refused.code not in ("unknown", "unset"):
            raise
        return None


def asked(server: str, ask: Ask[T]) -> Generator[Step, Any, T | None]:
    """Return a server's answer, or None while the server is away or has no value yet.

    Raises:
        CallRefusedError: the server refuses the request, and always will.
    """
    try:
        return (yield from do(server, ask))
    except RobotConnectionError as problem:
        _pass_over(problem)
        return None


def adjusted(x_mm: float, y_mm: float, turn_deg: float) -> Generator[Step, Any, bool]:
    """Correct RServer's position by so much; False where RServer is away.

    Raises:
        CallRefusedError: it refuses that, and always will.
    """
    try:
        yield from do("RServer", robot.adjust_position(x_mm, y_mm, turn_deg))
    except RobotConnectionError as problem:
        _pass_over(problem)
        return False
    return True


def _pass_over(problem: RobotConnectionError) -> None:
    """Pass over a connection problem, as a dead server is restarted; but raise a refusal, which is final."""
    if isinstance(problem, CallRefusedError) and problem.code not in _NOT_YET:
        raise problem
