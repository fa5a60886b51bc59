"""The part of a run that is shown: its first seconds, with times from 0."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

import msgspec

from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.observer import Sink
from colony.runtime.protocol.topics import CLOCK

# --- window --------------------------------------------------------------------------------------------


class RecordingWindow:
    """A sink that passes the frames of the window to other sinks. Mutable.

    Args:
        length_ns: length of the part of the run to show; None for the whole run.
        frame_ns: length of a frame.
        sinks: sinks that get the frames with times from 0.
    """

    def __init__(self, length_ns: int | None, *, frame_ns: int, sinks: tuple[Sink, ...]) -> None:
        self._length_ns = length_ns
        self._frame_ns = frame_ns
        self._sinks = sinks
        self._recordings: list[Sink] = []
        self._begin_ns: int | None = None
        self._shown_ns = 0
        self._shut = False
        self.changed = threading.Event()
        """Set when the first frame has been shown, and when the window is over."""

    def record(self, sink: Sink) -> None:
        """Add a sink that gets the frames in the robot's own time; call it before the first frame."""
        self._recordings.append(sink)

    def take(self, log: RunFrame) -> None:
        """Pass a frame to the sinks if it is inside the window."""
        if self._shut:
            return
        is_first = self._begin_ns is None
        if self._begin_ns is None:
            self._begin_ns = log.tick.t_ns
        t_ns = log.tick.t_ns - self._begin_ns
        if self._length_ns is not None and t_ns >= self._length_ns:
            self.shut()
            return
        for sink in self._recordings:
            sink.take(log)
        tick = msgspec.structs.replace(log.tick, t_ns=t_ns)
        shifted = replace(log, tick=tick, frame=log.frame._replace(t_ns=log.frame.t_ns - self._begin_ns))
        for sink in self._sinks:
            sink.take(shifted)
        self._shown_ns = t_ns + self._frame_ns
        if is_first:
            self.changed.set()

    def close(self) -> None:
        """Close all sinks."""
        self._shut = True
        with ExitStack() as closing:  # closes all, even if closing one fails
            for sink in (*self._sinks, *self._recordings):
                closing.callback(sink.close)

    def shut(self) -> None:
        """Ignore all frames from now on. May be called from any thread."""
        self._shut = True
        self.changed.set()

    @property
    def begin_ns(self) -> int | None:
        """The robot's time at the first frame; None before it."""
        return self._begin_ns

    @property
    def begun(self) -> bool:
        """True if a frame has been shown."""
        return self._shown_ns > 0

    @property
    def remaining_ns(self) -> int | None:
        """The length that has not been shown yet; None without an end."""
        return None if self._length_ns is None else max(0, self._length_ns - self._shown_ns)

    @property
    def over(self) -> bool:
        """True if the whole window has been shown, or `shut` was called."""
        return self._shut

    @property
    def shown_ns(self) -> int:
        """The length shown so far, to the end of the last frame."""
        return self._shown_ns


# --- clock watch ---------------------------------------------------------------------------------------
#
# The presence of the robot's Clock during a run: without it no frame is decided.


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

    def __init__(self, robot: str, window: RecordingWindow, report: Callable[[str], None]) -> None:
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
