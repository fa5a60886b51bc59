"""The result of an audit as data, in the form printed by `colony audit --format json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from colony.analysis.follower import DamagedSpan
from colony.ir.frame import Decision

Role = Literal["wins", "active", "inactive", "silent"]
"""The role of a client according to the interpreter. "active": its predicate holds, but it does not win."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientExplanation:
    """A client in a frame that differs: its recorded fate, if any, and its role (`part`)."""

    client: str
    fate: str | None
    part: Role


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A difference from the interpreter in frame `index` of the recording.

    `actuator` and the decisions are None if the difference concerns no actuator. `missing` are the sensors
    without a value in the frame.
    """

    index: int
    k: int
    t_ns: int
    actuator: str | None
    message: str
    recorded: Decision | None = None
    expected: Decision | None = None
    clients: tuple[ClientExplanation, ...] = ()
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ContractCount:
    """A contract that the interpreter found broken in `frames` frames, the first and last at these times."""

    contract: str
    frames: int
    first_ns: int
    last_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditReport:
    """The result of an audit.

    A decision is the command for one actuator in one frame.

    Attributes:
        frames: the number of recorded frames.
        first_ns: the time of the first frame.
        last_ns: the time of the last frame.
        compared: the number of decisions that were compared with the interpreter's.
        idled: the number of them that were the idle command instead, because a client was late, lost or
            refused.
        unheard: the number of decisions that were not recorded, because no verdict of their server arrived.
        late: the number of frames in which a client was late.
        lost: the number of frames in which a client was lost.
        refused: the number of frames in which a client was refused.
        violations: the number of frames in which two clients commanded one actuator.
        outside: the number of frames in which a client outside the network commanded.
        holds: the number of frames in which the emergency stop or a lock kept the network from deciding.
        restarts: the number of epochs after the first.
        unknown: the number of frames that were not compared because the frame's own memory or answers were
            not recorded.
        differing: the number of frames that differ from the interpreter.
        first: the first difference, if any.
        contracts: the contracts that the interpreter found broken.
        damaged: the damaged sections.
        forgotten: the number of frames that were not compared because memory was lost in an earlier frame or
            is not in the recording, which has had no keyframe since.
        resumed: the number of keyframes from which the interpreter continued.
        undecided: the number of decisions of actuators with `on_loss degrade` that were not compared after
            the interpreter continued from a keyframe without the memory for lost clients.
        unheard_by_server: the servers of the decisions that were not recorded, each with their number.
    """

    frames: int
    first_ns: int
    last_ns: int
    compared: int
    idled: int
    unheard: int
    late: int
    lost: int
    refused: int
    violations: int
    outside: int
    holds: int
    restarts: int
    unknown: int
    differing: int
    first: Difference | None
    contracts: tuple[ContractCount, ...]
    damaged: tuple[DamagedSpan, ...] = ()
    forgotten: int = 0
    resumed: int = 0
    undecided: int = 0
    unheard_by_server: Mapping[str, int] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """True if every frame agrees with the interpreter."""
        return self.first is None

    def as_json(self) -> dict[str, object]:
        """Return the report as plain dicts and lists."""
        out: dict[str, Any] = {"agrees": self.agrees, **asdict(self)}
        if self.first is not None:
            for name, decision in (("recorded", self.first.recorded), ("expected", self.first.expected)):
                out["first"][name] = None if decision is None else decision._asdict()
        return out
