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


def answer_timeout(call: Ask[Any], requested_s: float | None, default_s: float) -> float:
    """Return the timeout in seconds: `requested_s`; if None, `default_s`, or longer if the call needs it.

    Raises:
        TypeError: `call` is not a call of a library.
    """
    if not isinstance(call, Ask):
        hint = ": call it" if callable(call) else ""
        raise TypeError(
            f"not a call: {call!r}{hint}; expected the result of a library function, such as robot.go(200)"
        )
    if requested_s is not None:
        return requested_s
    return default_s if call.wait_s is None else max(default_s, call.wait_s)


def read_result(server: str, call: Ask[T], outcome: Outcome) -> T:
    """Return the result of a call.

    Raises:
        CallRefusedError, ConnectionLostError: the call has no result.
    """
    if isinstance(outcome, RobotConnectionError):
        raise outcome
    try:
        result: T = _decoder(call.reply).decode(outcome)
    except msgspec.DecodeError as problem:
        text = f"{server}.{call.method} returned an invalid result: {problem}"
        raise CallRefusedError("reply", text) from None
    return result


@lru_cache(maxsize=256)
def _decoder(result: Any) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(result)
