"""Conditions about the past: what memory functions remembered before a frame."""

from __future__ import annotations

from typing import Literal

from colony.ir import expression as ir
from colony.verify.explain.causes import Past, Remembered
from colony.verify.explain.formula import Leaf
from colony.verify.explain.moment import Moment
from colony.verify.source_text import source_text


def past_recently(moment: Moment, e: ir.MemoryCall, last: int | None) -> Leaf:
    """Return the condition that the argument was true within the duration; `last` is when, in ns."""
    elapsed = None if last is None else moment.t_ns - last
    holds = elapsed is not None and elapsed < e.duration_ns
    return _past(moment, e, "recently", last, elapsed, holds=holds)


def past_sustained(moment: Moment, e: ir.MemoryCall, last: tuple[int, int] | None, *, is_true: bool) -> Leaf:
    """Return the condition that the argument has been true for the duration.

    Args:
        moment: the frame.
        e: the call.
        last: the time since which it was true, in ns, and the number of the last frame in which it was.
        is_true: True if it is true in this frame.
    """
    unbroken = last is not None and last[1] == moment.values.number - 1
    since = None if not is_true else last[0] if unbroken and last is not None else moment.t_ns
    elapsed = None if since is None else moment.t_ns - since
    holds = elapsed is not None and elapsed >= e.duration_ns
    return _past(moment, e, "sustained", since, elapsed, holds=holds)


def _past(
    moment: Moment,
    e: ir.MemoryCall,
    function: Literal["recently", "sustained"],
    at_ns: int | None,
    elapsed_ns: int | None,
    *,
    holds: bool,
) -> Leaf:
    cause = Past(
        function=function,
        condition=source_text(e.arguments[0]),
        duration_ns=e.duration_ns,
        at_ns=at_ns,
        elapsed_ns=elapsed_ns,
    )
    return Leaf(holds=holds, cause=cause, key=("past", e.cell), span=e.span, node=e, fixed=moment.is_first)


def remembered(moment: Moment, e: ir.MemoryCall, *, value: bool, condition: str = "") -> Leaf:
    """Return the condition that a memory function remembers `value`; its text is `condition` or the call."""
    since = moment.earlier.cells.get((e.cell, (), 0))
    cause = Remembered(
        condition=condition or source_text(e),
        value="true" if value else "false",
        since_ns=None if since is None or since.first else since.t_ns,
    )
    return Leaf(holds=value, cause=cause, key=("memory", e.cell), span=e.span, node=e, fixed=moment.is_first)


def rests_on_past_alone(e: ir.Expression) -> bool:
    """Return True for a memory function whose own condition is about earlier frames only."""
    return isinstance(e, ir.MemoryCall) and e.function not in (
        ir.MemoryFunction.CAPTURED,
        ir.MemoryFunction.CHANGED,
    )
