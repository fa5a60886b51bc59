"""Timeouts and results of calls, for all kinds of connections."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, TypeVar

import msgspec

from colony.runtime.kit.conversation import Outcome
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError
from colony.runtime.library.ask import Ask

T = TypeVar("T")

TIMEOUT_S = 5.0
"""Default timeout of a call, in seconds."""


def answer_timeout(ask: Ask[Any], requested_s: float | None, default_s: float) -> float:
    """Return the timeout in seconds: `requested_s`; if None, `default_s`, or longer if the call needs it.

    Raises:
        TypeError: `ask` is not a call of a library.
    """
    if not isinstance(ask, Ask):
        hint = ": call it" if callable(ask) else ""
        raise TypeError(
            f"not a call: {ask!r}{hint}; expected the result of a library function, such as robot.go(200)"
        )
    if requested_s is not None:
        return requested_s
    return default_s if ask.wait_s is None else max(default_s, ask.wait_s)


def read_result(server: str, ask: Ask[T], outcome: Outcome) -> T:
    """Return the result of a call.

    Raises:
        CallRefusedError, ConnectionLostError: the call has no result.
    """
    if isinstance(outcome, RobotConnectionError):
        raise outcome
    try:
        result: T = _decoder(ask.reply).decode(outcome)
    except msgspec.DecodeError as problem:
        text = f"{server}.{ask.method} returned an invalid result: {problem}"
        raise CallRefusedError("reply", text) from None
    return result


@lru_cache(maxsize=256)
def _decoder(result: Any) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(result)
