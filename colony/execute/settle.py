"""What an actuator is sent, given its winner's command: limits, range, units, and the idle command instead.

Stands on its own, on `math` alone, like `arithmetic`: the Python backend copies it into what it generates.
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
) -> tuple[
    tuple[str, str | None, tuple[float | bool, ...] | None, str | None],
    tuple[float | bool, ...] | None,
    tuple[tuple[str, str], ...],
]:
    """The decision (values in declared units), what is sent in base units, and the records.

    `fields` are (name, factor, low, high); `limits` are those that apply, as (field, whether from above,
    bound), bounds finite.
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
    leaving = leave(tuple(sent), fields)
    if not all(map(isfinite, command + leaving)):
        out = None if idle is None else leave(idle, fields)
        return (actuator, by, out, "not finite"), idle, (*records, ("not finite", by))
    return (actuator, by, leaving, None), tuple(sent), records + found


def leave(
    values: tuple[float | bool, ...], fields: tuple[tuple[str, float, float | None, float | None], ...]
) -> tuple[float | bool, ...]:
    """A command in declared units; a bool has none."""
    return tuple(
        [
            value if isinstance(value, bool) else value / factor
            for value, (_, factor, _, _) in zip(values, fields, strict=True)
        ]
    )
