"""What a recording holds, whatever its format: the run that it is of, and its frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from colony.execute.compiled import SourceFile
from colony.ir.frame import Answer, Frame
from colony.ir.program import Program
from colony.runtime.observe.monitor import Keyframe
from colony.runtime.protocol.messages import Tick, Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class RunInfo:
    """What run it was. `clients` are actuator, module and priority, highest place first.

    `program` is the place of the behavior that was run among `sources`, "" where these are not known;
    `run` names the run on a real robot; `started` is when that was, for people.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedFrame:
    """One frame as it was recorded (see `FrameLog`); `breaches` is None where the format leaves them out.

    A verdict is absent where none was heard. What the format leaves out of ticks and verdicts is as if
    nothing had been there; of `fates`, JSON lines have only those that are worth telling. `damaged`: what was
    recorded between the frame before this one and this one is damaged and left out.
    """

    tick: Tick
    frame: Frame
    verdicts: Mapping[str, Verdict]
    restart: bool = False
    skipped: int = 0
    memory_unknown: bool = False
    breaches: tuple[str, ...] | None = None
    keyframe: Keyframe | None = None
    damaged: bool = False
    answers: Mapping[str, Answer] = field(default_factory=dict)


class RecordingReader(Protocol):
    """A recording that was opened. `run` is None where the format does not tell."""

    @property
    def run(self) -> RunInfo | None: ...

    @property
    def cut(self) -> str | None:
        """Once all frames were read: how the recording breaks off; None where it does not."""
        ...

    @property
    def damaged(self) -> bool:
        """Once all frames were read: whether what comes after the last of them is damaged."""
        ...

    def frames(self, program: Program) -> Iterator[RecordedFrame]:
        """Its frames that are not damaged, once, in their order, as frames of `program`.

        Raises:
            Failure: what is recorded is none of that program's, or malformed.
        """
        ...
