"""The user interface of `colony run --shadow`: what would have been sent, one line at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from colony.cli.reporting import say
from colony.cli.run.user_interface import TERMINAL_INTERFACE
from colony.ir.program import Actuator, ActuatorField
from colony.ir.types import Enum, ScalarValue
from colony.robots.request import UserInterface
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Verdict

REPEAT_NS = 1_000_000_000
"""Nanoseconds after which a line is repeated although the winner has not changed."""


def shadow_interface(actuators: tuple[Actuator, ...]) -> UserInterface:
    """Return the interface at the terminal, which shows the decisions instead of a progress bar."""
    return replace(TERMINAL_INTERFACE, progress=lambda length_ns: Decisions(actuators, say))


class Decisions:
    """A sink that reports what would be sent when the winner changes, and once a second. Mutable.

    Args:
        actuators: the actuators of the program.
        report: callback for a line.
    """

    def __init__(self, actuators: tuple[Actuator, ...], report: Callable[[str], None]) -> None:
        self._actuators = actuators
        self._report = report
        self._winners: dict[str, str | None] = {}
        self._reported_ns: int | None = None

    def take(self, log: RunFrame) -> None:
        """Report a frame, if it is time to."""
        t_ns, reported_ns = log.tick.t_ns, self._reported_ns
        winners = {name: verdict.by for name, verdict in log.verdicts.items()}
        if winners == self._winners and reported_ns is not None and t_ns - reported_ns < REPEAT_NS:
            return
        self._winners, self._reported_ns = winners, t_ns
        parts = [_would_send(a, log.verdicts[a.name]) for a in self._actuators if a.name in log.verdicts]
        self._report(f"{t_ns / 1e9:8.2f} s  would send {'; '.join(parts)}")

    def close(self) -> None:
        """Do nothing: every line has been reported."""


def _would_send(actuator: Actuator, verdict: Verdict) -> str:
    fault = f" ({verdict.fault})" if verdict.fault else ""
    if verdict.values is None:
        return f"nothing to {actuator.name}{fault}"
    pairs = zip(actuator.fields, verdict.values, strict=True)
    command = ", ".join(f"{field.name} = {_value(field, value)}" for field, value in pairs)
    return f"{actuator.name}({command}) by {verdict.by or 'nobody'}{fault}"


def _value(field: ActuatorField, value: ScalarValue) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(field.type, Enum):
        return next((name for name, number in field.type.members if number == value), f"{value:g}")
    return f"{value + 0.0:.4g} {field.unit}".rstrip()  # + 0.0: no minus before a zero
