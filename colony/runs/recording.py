"""The recording of a run: the format, chosen by the file's name, and the sink that writes it."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from colony import __version__
from colony.files import limit_advice, open_exclusive, reason
from colony.runs.spec import MisuseError

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled
    from colony.runtime.frames.run_frame import RunFrame
    from colony.runtime.recordings.lines import Recording
    from colony.runtime.recordings.mcap_writer import McapRecording

SUFFIX = ".mcap"
"""Suffix of MCAP recordings; all others are JSON lines."""


def is_mcap(path: str | None) -> bool:
    """Return True if a recording of this name is MCAP, which also contains the clients' requests."""
    return path is not None and Path(path).suffix == SUFFIX


def new_run_name() -> str:
    """Return a name for a run on a robot: the time, and the id of this process."""
    return f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"


@dataclass(frozen=True, slots=True)
class LiveRun:
    """A run on a robot, or in the `shadow` of one: its name, and its start time as text for users."""

    name: str
    shadow: bool = field(default=False, kw_only=True)
    started: str = field(default_factory=lambda: time.strftime("%Y-%m-%dT%H:%M:%S%z"), kw_only=True)


class RunRecording:
    """A sink that records a run. Stateful: it remembers why the recording broke off.

    A recording breaks off if it cannot be written, for example because the disk is full.

    Args:
        sink: the writer of the recording.
        path: the path of the file.
    """

    def __init__(self, sink: Recording | McapRecording, path: str) -> None:
        self._sink = sink
        self._path = path
        self._problem: OSError | None = None
        self._first_ns: int | None = None

    def take(self, log: RunFrame) -> None:
        """Record a frame, unless the recording has broken off."""
        if self._problem is not None:
            return
        try:
            self._sink.take(log)
        except OSError as problem:
            self._problem = problem
            return
        if self._first_ns is None:
            self._first_ns = log.frame.t_ns

    def close(self) -> None:
        """Close the file."""
        try:
            self._sink.close()
        except OSError as problem:
            self._problem = self._problem or problem

    @property
    def truncation(self) -> str | None:
        """The length of a truncated recording and the reason for its end; None if it is complete."""
        if self._problem is None:
            return None
        first_ns, last_ns = self._first_ns, self._sink.written_ns
        seconds = 0.0 if first_ns is None or last_ns is None else (last_ns - first_ns) / 1e9
        why = _reason_with_advice(self._problem)
        return f"the recording {self._path} contains only the first {seconds:.2f} s: {why}"

    def expect_frames(self) -> None:
        """Check that the first frame was written.

        Raises:
            MisuseError: the recording broke off before.
        """
        if self._problem is not None and self._sink.written_ns is None:
            raise _cannot_write(self._path, _reason_with_advice(self._problem))


def _reason_with_advice(problem: OSError) -> str:
    advice = limit_advice(problem)
    return reason(problem) if advice is None else f"{reason(problem)}: {advice}"


def _cannot_write(path: str, why: str) -> MisuseError:
    return MisuseError(f"{path}: error: cannot write: {why}")


def recording_into(
    path: str,
    compiled: Compiled,
    *,
    seed: int,
    robot: str | None = None,
    live: LiveRun | None = None,
    heard: tuple[str, ...] = (),
) -> RunRecording:
    """Return a sink that records a run of a robot into `path`.

    `robot` is its name; None for that of its description. `live` is None for a run in virtual time. `heard`
    are the actuators that another controller commands.

    Raises:
        MisuseError: the file cannot be written, or another run is recording into it.
    """
    try:
        file = open_exclusive(path)
        if not is_mcap(path):
            from colony.runtime.recordings.lines import Recording

            is_shadow = live is not None and live.shadow
            return RunRecording(Recording(compiled, file, shadow=is_shadow), path)
        from colony.runtime.recordings.mcap_writer import McapRecording
        from colony.runtime.recordings.recorded import RunInfo

        info = RunInfo(
            robot=robot or compiled.name,
            frame_ns=compiled.frame_ns,
            seed=seed,
            version=__version__,
            clients=compiled.clients,
            program=compiled.root,
            sources=compiled.sources,
            run="" if live is None else live.name,
            started="" if live is None else live.started,
            shadow=live is not None and live.shadow,
            site=compiled.site,
            heard=heard,
        )
        return RunRecording(McapRecording(compiled, info, file), path)
    except BlockingIOError:
        raise _cannot_write(path, "another run is recording into it") from None
    except OSError as problem:
        raise _cannot_write(path, _reason_with_advice(problem)) from None
