"""The values that the parameters of a command take, and the fields of an actuator."""

from __future__ import annotations

from collections.abc import Collection
from math import isfinite


def expected_instead(
    value: object, *, is_bool: bool, members: Collection[float], low: float | None, high: float | None
) -> str | None:
    """Return what was expected in place of a value, or None if the value is one of those.

    Args:
        value: the value, in base units.
        is_bool: True if a bool is expected.
        members: the numbers of an enum's members; empty for other kinds.
        low: the least number, None for any.
        high: the greatest number, None for any.
    """
    if is_bool:
        return None if isinstance(value, bool) else "a bool"
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value):
        return "a finite number"
    if members:
        numbers = ", ".join(f"{member:g}" for member in members)
        return None if value in members else f"the number of a member: {numbers}"
    if (low is None or value >= low) and (high is None or value <= high):
        return None
    return " to ".join("any" if bound is None else f"{bound:g}" for bound in (low, high))
