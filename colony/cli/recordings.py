"""Recordings by the names of their files: how a run is written, and how what was written is opened."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn

from colony import __version__
from colony.cli.outputs import cannot_write, open_alone
from colony.diagnostics import Failure, error
from colony.files import open_regular, reason
from colony.source import Source, Span

if TYPE_CHECKING:
    from colony.compile.clients import ClientList
    from colony.ir.program import Program
    from colony.runtime.observer import Sink
    from colony.runtime.recordings.recorded import RecordingReader

SUFFIX = ".mcap"
"""Of recordings as MCAP; all others are JSON lines."""


def is_mcap(path: str | None) -> bool:
    """Whether a recording of this name is MCAP, which also tells what clients requested."""
    return path is not None and Path(path).suffix == SUFFIX


def recording_into(
    path: str,
    file: str,
    program: Program,
    clients: ClientList,
    *,
    seed: int,
    run: str = "",
    started: str = "",
) -> Sink:
    """A sink that records a run of the behavior `file` into `path`; exits with 2 where it cannot be written.

    `run` names a run on a real robot, `started` when it was.
    """
    try:
        opened = open_alone(path)
        if not is_mcap(path):
            from colony.runtime.recordings.lines import Recording

            return Recording(program, opened)
        from colony.cli.recorded_program import program_sources
        from colony.runtime.recordings.mcap_writer import McapRecording
        from colony.runtime.recordings.recorded import RunInfo, places

        root, sources = program_sources(file, program)
        info = RunInfo(
            robot=program.robot.name,
            frame_ns=program.robot.frame_ns,
            seed=seed,
            version=__version__,
            clients=places(clients),
            program=root,
            sources=sources,
            run=run,
            started=started,
        )
        return McapRecording(program, info, opened)
    except BlockingIOError:
        cannot_write(path, "another run is recording into it")
    except OSError as problem:
        cannot_write(path, problem.strerror or str(problem))


def open_recording(path: str) -> BinaryIO:
    """The file of a recording.

    Raises:
        Failure: A001, it cannot be read.
    """
    try:
        return open_regular(path)
    except OSError as problem:
        _unreadable(path, reason(problem))


def _unreadable(path: str, why: str) -> NoReturn:
    raise Failure([error("A001", Span(Source(path, ""), 0, 0), f"cannot read the recording: {why}")])


def read_recording(file: BinaryIO, name: str) -> RecordingReader:
    """The reader of a recording, by how it begins.

    Raises:
        Failure: A002, it is no recording.
    """
    from colony.runtime.recordings.reader import MAGIC, LinesReader

    head = file.read(len(MAGIC))
    file.seek(0)
    if head == MAGIC:
        from colony.runtime.recordings.mcap_reader import McapReader

        return McapReader(file, name)
    if head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b""):
        return LinesReader(file, name)
    message = "this is no recording: neither MCAP nor JSON lines"
    raise Failure([error("A002", Span(Source(name, ""), 0, 0), message)])
