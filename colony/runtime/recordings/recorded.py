"""The content of a recording in either format: its run and its frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from colony.execute.compiled import SourceFile
from colony.ir.program import Program
from colony.ir.site import Site
from colony.runtime.frames.run_frame import FilePosition, RunFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class RunInfo:
    """The recorded run. `clients` are actuator, module and priority, highest priority first.

    `program` is the path in `sources` of the behavior that was run, "" if the sources are unknown. `run` is
    the name of a run on a real robot, and `started` its start time as text for users.
    `shadow` is True if the program ran in the shadow of the robot and commanded nothing; `heard` are the
    actuators that another controller commanded meanwhile, which a reader leaves empty. `site` has the
    params that a site set. `program_damage` is the reason why a file is missing from `sources`, "" if none
    is.
    """

    robot: str
    frame_ns: int
    seed: int
    version: str
    clients: tuple[tuple[str, str, int], ...]
    program: str = ""
    sources: tuple[SourceFile, ...] = ()
    run: str = ""
    started: str = ""
    shadow: bool = False
    heard: tuple[str, ...] = ()
    site: Site | None = None
    program_damage: str = ""


class RecordingReader(Protocol):
    """An open recording."""

    @property
    def run(self) -> RunInfo | None:
        """The recorded run, None if the format contains no information about it."""
        ...

    @property
    def truncation(self) -> str | None:
        """A text on how the recording breaks off, None if it is whole; valid after all frames were read."""
        ...

    @property
    def remarks(self) -> Sequence[str]:
        """Texts on what else of the recording is not read or not known; valid after all frames were read."""
        ...

    @property
    def shadow(self) -> bool:
        """True if the program ran in the shadow of a robot; valid after all frames were read."""
        ...

    @property
    def damaged(self) -> bool:
        """True if data after the last frame is damaged; valid after all frames were read."""
        ...

    def go_to(self, place: FilePosition) -> None:
        """Let the first frame be the one at a place in the file; call it before `frames`."""
        ...

    def frames(self, program: Program) -> Iterator[RunFrame]:
        """Yield the undamaged frames in order, as frames of `program`. Call this once.

        Raises:
            DiagnosticError: the frames are not of that program, or malformed.
        """
        ...
