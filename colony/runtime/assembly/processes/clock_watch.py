"""The presence of the robot's Clock during a run: without it no frame is decided."""

from __future__ import annotations

from collections.abc import Callable

from colony.runtime.assembly.processes.window import Window
from colony.runtime.protocol.topics import CLOCK

REPORT_AFTER_S = 2.0
"""Absence of the Clock in seconds after which it is reported; a Clock that is restarted is back before."""

GIVE_UP_AFTER_S = 30.0
"""Absence of the Clock in seconds after which a run fails.

It is longer than all pauses between the restarts of a process (8 s) and the start of a whole robot (20 s).
"""


class ClockWatch:
    """How long the Clock has been absent. Mutable; `note` may be called from any thread.

    Args:
        robot: name of the robot, for messages.
        report: callback for one line when the Clock has been absent for a while, and one when it is back.
    """

    def __init__(self, robot: str, report: Callable[[str], None]) -> None:
        self._robot = robot
        self._report = report
        self._left_at_s: float | None = None
        self._reported_since_s: float | None = None

    def note(self, present: bool, now_s: float) -> None:
        """Record that the Clock joined or left the robot's processes at `now_s`, in monotonic seconds."""
        if present:
            self._left_at_s = None
        elif self._left_at_s is None:
            self._left_at_s = now_s

    def note_frames(self, length_s: float, now_s: float) -> None:
        """Record that frames of this total length were shown: the Clock ran for as much longer.

        When they are shown is no sign of life: the observer may have handled their last messages late.
        """
        if self._left_at_s is not None:
            self._left_at_s = min(self._left_at_s + length_s, now_s)

    def absent_s(self, now_s: float) -> float:
        """Return for how many seconds the Clock has been absent, 0.0 if it is present."""
        left_at_s = self._left_at_s
        return 0.0 if left_at_s is None else now_s - left_at_s

    def check(self, now_s: float) -> str | None:
        """Report a change; return why the run must end, None if it may go on."""
        absent_s = self.absent_s(now_s)
        if absent_s >= GIVE_UP_AFTER_S:
            return f"{self._robot} has not answered for {GIVE_UP_AFTER_S:g} s: its Clock does not run"
        if self._reported_since_s is None:
            if absent_s >= REPORT_AFTER_S:
                self._reported_since_s = now_s - absent_s
                self._report(
                    f"{self._robot} does not answer: its Clock does not run; "
                    f"waiting up to {GIVE_UP_AFTER_S:g} s for it"
                )
        elif absent_s < REPORT_AFTER_S:
            self._report(f"{self._robot} answers again, after {now_s - self._reported_since_s:.1f} s")
            self._reported_since_s = None
        return None


class WindowWatch:
    """The watch over the Clock of a run that has begun, whose window its absence may end. Mutable.

    Args:
        robot: name of the robot, for messages.
        window: the part of the run to show.
        report: callback for one line about each change.
    """

    def __init__(self, robot: str, window: Window, report: Callable[[str], None]) -> None:
        self._robot, self._window, self._report = robot, window, report
        self._clock_watch = ClockWatch(robot, report)
        self._shown_ns = 0

    def note(self, address: str, present: bool, now_s: float) -> None:
        """Record that a node joined or left the robot's processes; may be called from any thread."""
        if address == CLOCK:
            self._clock_watch.note(present, now_s)

    def check(self, now_s: float) -> str | None:
        """Return why the run must end, None if it may go on; shut the window if its length is over."""
        window = self._window
        if not window.begun:
            return None
        shown_ns = window.shown_ns
        self._clock_watch.note_frames((shown_ns - self._shown_ns) / 1e9, now_s)
        self._shown_ns = shown_ns
        failure = self._clock_watch.check(now_s)
        absent_s, remaining_ns = self._clock_watch.absent_s(now_s), window.remaining_ns
        if failure is None and absent_s and remaining_ns is not None and absent_s * 1e9 >= remaining_ns:
            self._report(f"{self._robot} did not answer in the last {absent_s:.1f} s of the run")
            window.shut()
        return failure
