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
    bounds = [[low, high] for _, _, low, high in fields]
    for at, above, bound in limits:
        if bound is None:
            if idle is None:
                return "bound missing", None, (*records, ("bound missing", f"{actuator}.{fields[at][0]}"))
            bound = idle[at]
        former = bounds[at][above]
        if former is None or (bound < former if above else bound > former):
            bounds[at][above] = bound
    sent = []
    found: tuple[tuple[str, str], ...] = ()
    for value, (low, high), (name, _, least, most) in zip(command, bounds, fields, strict=True):
        if low is not None and high is not None and low > high:
            return "limits contradict", idle, (*records, ("limits contradict", f"{actuator}.{name}"))
        if low is not None and value < low:
            found += (("command clamped" if low == least else "limited", f"{actuator}.{name}"),)
            value = low
        elif high is not None and value > high:
            found += (("command clamped" if high == most else "limited", f"{actuator}.{name}"),)
            value = high
        sent.append(value)
    # in a unit smaller than the base unit a field may be too large for a double
    declared = [x / factor for x, (_, factor, _, _) in zip(sent, fields, strict=True) if factor < 1.0]
    if not all(map(isfinite, declared)):
        return "not finite", idle, (*records, ("not finite", by))
    return None, tuple(sent), records + found
