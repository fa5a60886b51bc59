"""The emergency stop, at the Clock and at the servers of actuators.

The Clock has the `StopLatch`: it keeps the stop in a file, repeats it in every tick, and alone releases it. A
server of actuators has a `StopFollower`: a call of its own or a tick stops it, its frames carry the stop, and
it goes on when a tick carries a release that is not earlier than the stop. So a server that heard a stop
needs no other process to stay stopped, and a Clock that missed the call, or was restarted, learns of the stop
from frames.

    stop heard at t   is over   once a release at r >= t is known, and only then

A file that cannot be read counts as a stop: a robot that may have been stopped for a reason does not drive on
because of a bad disk. How the file is written is told in `stop_file.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from colony.files import reason
from colony.runtime.arbitration.stop_file import BadStopFile, Kept, StopFile
from colony.runtime.protocol.messages import Stopped, Tick

NEVER_RELEASED_NS = -1
"""The time of the last release if there was none."""

UNREADABLE = "a file that cannot be read"
"""The author of a stop that holds because nobody knows whether the robot was stopped."""

LONGEST_BY = 255
"""Characters kept of the connection that stopped the robot; each takes at most six bytes in the file."""

CHECK_NS = 1_000_000_000
"""Nanoseconds between two checks that the file is in its place, and has what was written."""

FIRST_RETRY_NS, LAST_RETRY_NS = 50_000_000, 1_000_000_000
"""Nanoseconds until a file that could not be written is tried again: at first, and at most."""


class StopLatch:
    """The Clock's memory of the emergency stop. Mutable: whether it is on, and whether the file says so.

    Args:
        path: the file, which need not exist; with None, a restart forgets the stop.
        report: called with a line for people each time the file makes another kind of trouble.
    """

    def __init__(self, path: Path | None, *, report: Callable[[str], None] = lambda line: None) -> None:
        self._file = None if path is None else StopFile(path)
        self._report = report
        self._saved = self._unreadable = False
        self._due_ns = self._pause_ns = 0
        self.trouble: str | None = None
        """The reason why the file could not be read or written; None if all is well."""
        self.stopped: Stopped | None = None
        self.released_ns = NEVER_RELEASED_NS

    def begin(self, now_ns: int) -> None:
        """Take over what the file says, and reserve its room, at this time of the robot.

        What the file dates later is of another clock, from before the machine was started again: a stop holds
        from now on, and a release is that of stops which nobody remembers.
        """
        if self._file is not None:
            self._load(self._file)
        if self.stopped is not None and self.stopped.t_ns > now_ns:
            self.stopped = Stopped(by=self.stopped.by, t_ns=now_ns)
        if self.released_ns > now_ns:
            self.released_ns = NEVER_RELEASED_NS
        if not self._unreadable:
            self._keep()

    def engage(self, stopped: Stopped) -> None:
        """Stop; of several stops the first is remembered. Then the file has it, or there is `trouble`.

        The file is written for each stop, also where it should be up to date: each is acknowledged.
        """
        if self.stopped is None:
            self.stopped = Stopped(by=stopped.by[:LONGEST_BY], t_ns=stopped.t_ns)
        self._saved = False
        self._keep()

    def observe(self, stopped: Stopped | None) -> None:
        """Take over the stop that a server's frame carries, unless it has been released."""
        if stopped is not None and self.stopped is None and stopped.t_ns > self.released_ns:
            self.engage(stopped)

    def release(self, now_ns: int) -> None:
        """End every stop that was heard until `now_ns`. Then the file says so, or there is `trouble`."""
        self.stopped = None
        self.released_ns = now_ns
        self._saved = False
        self._keep()

    def save(self, now_ns: int) -> None:
        """Keep the file in its place and up to date; call this in each frame.

        After a failure the file is tried again, after longer and longer pauses. One that could not be read
        stays as it is until the robot is stopped or released.
        """
        if self._unreadable or now_ns < self._due_ns:
            return
        self._keep()
        self._pause_ns = min(max(2 * self._pause_ns, FIRST_RETRY_NS), LAST_RETRY_NS) if self.trouble else 0
        self._due_ns = now_ns + (self._pause_ns or CHECK_NS)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _keep(self) -> None:
        """Write the file unless it is up to date and nobody changed it; set or clear `trouble`."""
        self._unreadable = False
        if self._file is None or (self._saved and self._file.is_intact):
            return
        try:
            self._file.write(Kept(stopped=self.stopped, released_ns=self.released_ns))
        except (OSError, ValueError) as problem:
            self._tell("an emergency stop cannot be kept", f"{self._file.path}: {reason(problem)}")
        else:
            self._saved, self.trouble = True, None

    def _load(self, file: StopFile) -> None:
        try:
            kept = file.read()
        except (OSError, ValueError, BadStopFile) as problem:
            self._unreadable = True
            self.stopped = Stopped(by=UNREADABLE, t_ns=0)
            self._tell(
                "stopped until released, by a file that cannot be read", f"{file.path}: {reason(problem)}"
            )
            return
        if kept is not None:
            self.stopped, self.released_ns = kept.stopped, kept.released_ns

    def _tell(self, what: str, trouble: str) -> None:
        if trouble != self.trouble:
            self.trouble = trouble
            self._report(f"{what}: {trouble}")


class StopFollower:
    """A server's part in the emergency stop. Mutable: the stop that keeps its actuators idle, if any."""

    def __init__(self) -> None:
        self.stopped: Stopped | None = None

    def hear(self, stopped: Stopped) -> None:
        """Stop; of two stops, the later one has to be released."""
        if self.stopped is None or stopped.t_ns > self.stopped.t_ns:
            by = stopped.by if self.stopped is None else self.stopped.by
            self.stopped = Stopped(by=by, t_ns=stopped.t_ns)

    def follow(self, tick: Tick) -> None:
        """Stop or go on, as the Clock's tick says."""
        if self.stopped is not None and tick.released_ns >= self.stopped.t_ns:
            self.stopped = None
        if self.stopped is None:
            self.stopped = tick.stopped
