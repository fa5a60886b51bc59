"""The time of a physics: steps, what happens at their ends, and commands that take effect later."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Sequence
from typing import NamedTuple

from colony.sim.config import RobotConfig

MAX_STEP_S = 10.0

Step = Callable[[float], None]
"""A function that advances a physics by a number of seconds; it may move the time on while it does."""


class _Command(NamedTuple):
    """A command that takes effect at `due_ns`; `number` keeps the order of those that do so together."""

    due_ns: int
    number: int
    carry_out: Callable[[], None]


class StepTimeline:
    """The time of a physics, without a clock. Stateful: the time, and the commands that are underway.

    Args:
        configs: the robots, whose commands take effect and whose readings arrive after their delays.

    Attributes:
        elapsed_ns: the nanoseconds that were simulated so far.
    """

    def __init__(self, configs: Sequence[RobotConfig]) -> None:
        self.elapsed_ns = 0
        self._command_delays_ns = tuple(each.command_delay_ns for each in configs)
        self._reading_delays_ns = tuple(dict.fromkeys(each.reading_delay_ns for each in configs))
        self._has_delays = any((*self._command_delays_ns, *self._reading_delays_ns))
        self._step_callbacks: list[Callable[[], None]] = []
        self._underway: list[_Command] = []  # the next one first
        self._commands = 0

    def on_step(self, callback: Callable[[], None]) -> None:
        """Call `callback` at the end of each step from now on."""
        self._step_callbacks.append(callback)

    def carry_out(self, robot: int, command: Callable[[], None]) -> None:
        """Call `command` after the delay of a robot's commands, at once without one."""
        delay_ns = self._command_delays_ns[robot]
        if delay_ns:
            self._commands += 1
            insort(self._underway, _Command(self.elapsed_ns + delay_ns, self._commands, command))
        else:
            command()

    def advance(self, dt_s: float, step: Step) -> None:
        """Advance time by `dt_s` seconds, in one step, or in several if commands or readings are delayed.

        Raises:
            ValueError: the time is not above 0, or beyond `MAX_STEP_S`.
        """
        if not 0.0 < dt_s <= MAX_STEP_S:
            raise ValueError(f"cannot advance by {dt_s} s; expected a time above 0, up to {MAX_STEP_S:g} s")
        if self._has_delays:
            self._advance_with_delays(round(dt_s * 1e9), step)
        else:
            self._advance(dt_s, step)

    def _advance_with_delays(self, dt_ns: int, step: Step) -> None:
        """Advance in steps that end where a command takes effect, and where a reading is to be of.

        Readings at the end of this time, or of later ones that are as long, are as old as their delay if a
        step ends that long before.
        """
        end_ns = self.elapsed_ns + dt_ns
        measured_ns = [end_ns - delay_ns % dt_ns for delay_ns in self._reading_delays_ns]
        while self.elapsed_ns < end_ns:
            commanded_ns = self._underway[0].due_ns if self._underway else end_ns
            ends = (ns for ns in (*measured_ns, commanded_ns, end_ns) if ns > self.elapsed_ns)
            self._advance((min(ends) - self.elapsed_ns) / 1e9, step)

    def _advance(self, dt_s: float, step: Step) -> None:
        end_ns = self.elapsed_ns + round(dt_s * 1e9)
        step(dt_s)
        self.elapsed_ns = end_ns
        while self._underway and self._underway[0].due_ns <= end_ns:
            self._underway.pop(0).carry_out()
        for callback in self._step_callbacks:
            callback()
