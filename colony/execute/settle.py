"""Computation of the command sent from the winner's command: limits, range, or the idle command.

It uses only `math`, like `arithmetic`, as the Python backend copies it into generated programs.
"""

from __future__ import annotations

from math import isfinite


def settle(
    actuator: str,
    by: str,
    command: tuple[float | bool, ...],
    fields: tuple[tuple[str, float, float | None, float | None], ...],
    limits: tuple[tuple[int, bool, float], ...],
    idle: tuple[float | bool, ...] | None,
    records: tuple[tuple[str, str], ...],
) -> tuple[str | None, tuple[float | bool, ...] | None, tuple[tuple[str, str], ...]]:
    """Return the fault, the command sent in base units, and the records.

    `fields` are (name, factor, low, high). `limits` are those that apply, as (index of the field, True for an
    upper bound, bound); bounds are finite.
    """
    sent = []
    found: tuple[tuple[str, str], ...] = ()
    for i, value in enumerate(command):
        name, _, low, high = fields[i]
        limited = False
        for at, above, bound in limits:
            if at == i and (value > bound if above else value < bound):
                value, limited = bound, True
        if limited:
            found += (("limited", f"{actuator}.{name}"),)
        if low is not None and value < low:
            value = low
            found += (("command clamped", f"{actuator}.{name}"),)
        elif high is not None and value > high:
            value = high
            found += (("command clamped", f"{actuator}.{name}"),)
        sent.append(value)
    # in a unit smaller than the base unit a field may be too large for a double
    declared = [x / factor for x, (_, factor, _, _) in zip(sent, fields, strict=True) if factor < 1.0]
    if not all(map(isfinite, (*command, *declared))):
        return "not finite", idle, (*records, ("not finite", by))
    return None, tuple(sent), records + found
