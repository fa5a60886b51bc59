"""One frame of a run, as it is observed, recorded and read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from colony.ir.frame import Answer, Frame, Outcome
from colony.ir.memory import ProgramMemory
from colony.ir.types import ScalarValue
from colony.runtime.protocol.messages import Request, Tick, Verdict


class Keyframe(NamedTuple):
    """The memory before a frame, None if it is unknown.

    `degraded` is True if a client has been lost since the epoch began; the effect of `on_loss degrade` is
    then unknown.
    """

    memory: ProgramMemory | None
    degraded: bool = False


class FilePosition(NamedTuple):
    """A place in the file of a recording: an offset, and what a reader must know that starts there.

    `start` is the first frame of the epoch, and `topics` are the channels of an MCAP file, by number.
    """

    offset: int
    start: int
    topics: tuple[tuple[int, str], ...] = ()


class HeardCommand(NamedTuple):
    """A command that another controller gave an actuator: its fields in declared units, and its age."""

    values: tuple[ScalarValue, ...]
    age_ns: int


_UNDECIDED = Outcome(())


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFrame:
    """All data of one frame of a run.

    Attributes:
        tick: the number and time of the frame, and the lost clients. A recording has no other member of it.
        frame: the readings, in declared units.
        verdicts: the outcome of each actuator; absent if none was received.
        answers: the known answers of modules in Python.
        keyframe: the memory before the frame; the observer adds one at least every `KEYFRAME_NS`.
        restart: True if all memory restarted with this frame in the middle of a run.
        skipped: the number of frames directly before this one that could not be observed.
        memory_unknown: True if the observer did not know the memory before the frame.
        breaches: the contracts found broken; None if that was not recorded.
        expected: the outcome that the monitor expects, without decisions if memory is unknown, and in a
            frame of a recording.
        disagreements: differences of the verdicts from `expected` that no late or lost client excuses; there
            should never be any.
        requests: the clients' requests in order of arrival, if they are observed.
        damaged: True if frames of the recording are missing or damaged directly before this one.
        place: the place in the file from which a reader can go on with this frame; None if it cannot.
        heard: the command in force of another controller, for each actuator whose topic is heard; None if
            there is none.
        heard_breaches: the contracts that these commands broke.
    """

    tick: Tick
    frame: Frame
    verdicts: Mapping[str, Verdict]
    answers: Mapping[str, Answer] = field(default_factory=dict)
    keyframe: Keyframe | None = None
    restart: bool = False
    skipped: int = 0
    memory_unknown: bool = False
    breaches: tuple[str, ...] | None = None
    expected: Outcome = _UNDECIDED
    disagreements: tuple[str, ...] = ()
    requests: tuple[Request, ...] = ()
    damaged: bool = False
    place: FilePosition | None = None
    heard: Mapping[str, HeardCommand | None] = field(default_factory=dict)
    heard_breaches: tuple[str, ...] = ()

    @property
    def begins_epoch(self) -> bool:
        """True if all memory was initial before this frame."""
        return self.restart or self.tick.k == self.tick.start
