"""The part of a run that is shown: its first seconds, with times from 0."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from dataclasses import replace

import msgspec

from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.observer import Sink


class Window:
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
