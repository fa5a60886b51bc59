"""Computation of the command sent from the winner's command: limits, range, or the idle command.

It uses only `math`, like `arithmetic`, as the Python backend copies it into generated programs.
"""

from __future__ import annotations

from math import isfinite


def bounds_of(
    field: int,
    low: float | None,
    high: float | None,
    limits: tuple[tuple[int, bool, float | None], ...],
    idle: tuple[float | bool, ...] | None,
) -> tuple[float | None, float | None]:
    """Return the greatest lower and the least upper bound of a field, given its range and the limits."""
    for at, is_upper, bound in limits:
        if at == field:
            if bound is None:
                bound = idle[field]  # type: ignore[index]
            if is_upper:
                if high is None or bound < high:
                    high = bound
            elif low is None or bound > low:
                low = bound
    return low, high


def settle(
    actuator: str,
    by: str,
    command: tuple[float | bool, ...],
    fields: tuple[tuple[str, float, float | None, float | None], ...],
    limits: tuple[tuple[int, bool, float | None], ...],
    idle: tuple[float | bool, ...] | None,
    records: tuple[tuple[str, str], ...],
) -> tuple[str | None, tuple[float | bool, ...] | None, tuple[tuple[str, str], ...]]:
    """Return the fault, the command sent in base units, and the records.

    `fields` are (name, factor, low, high). `limits` are those that apply: (field index, True for an upper
    bound, bound); None for a bound that is missing or not finite, for which the idle command's value stands.
    """
    if not all(map(isfinite, command)):
        return "not finite", idle, (*records, ("not finite", by))
    if idle is None:
        missing = [at for at, _, bound in limits if bound is None]
        if missing:
            return (
                "bound missing",
                None,
                (*records, ("bound missing", f"{actuator}.{fields[min(missing)][0]}")),
            )
    sent = []
    found: tuple[tuple[str, str], ...] = ()
    is_sendable = True
    for i, value in enumerate(command):
        name, factor, least, most = fields[i]
        low, high = bounds_of(i, least, most, limits, idle)
        if low is not None and high is not None and low > high:
            return "limits contradict", idle, (*records, ("limits contradict", f"{actuator}.{name}"))
        if low is not None and value < low:
            found += (("command clamped" if low == least else "limited", f"{actuator}.{name}"),)
            value = low
        elif high is not None and value > high:
            found += (("command clamped" if high == most else "limited", f"{actuator}.{name}"),)
            value = high
        # in a unit smaller than the base unit a field may be too large for a double
        is_sendable = is_sendable and (factor >= 1.0 or isfinite(value / factor))
        sent.append(value)
    if not is_sendable:
        return "not finite", idle, (*records, ("not finite", by))
    return None, tuple(sent), records + found
