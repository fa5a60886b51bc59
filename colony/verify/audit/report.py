"""The result of an audit as data, in the form printed by `colony audit --format json`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from colony.ir.frame import Decision

Part = Literal["wins", "active", "inactive", "silent"]
"""The role of a client according to the interpreter. "active": its predicate holds, but it does not win."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientAccount:
    """A client in a differing frame: its recorded fate, if any, and its role according to the interpreter."""

    client: str
    fate: str | None
    part: Part


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
    clients: tuple[ClientAccount, ...] = ()
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ContractCount:
    """A contract that the interpreter found broken in `frames` frames, the first and last at these times."""

    contract: str
    frames: int
    first_ns: int
    last_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DamagedSpan:
    """A damaged section of the recording: the times of the intact frames around it, None if there is none."""

    after_ns: int | None
    before_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditReport:
    """The result of an audit.

    `compared` counts decisions (one per actuator and frame), `idled` those of them that were idle because a
    client was late, lost or refused; `unheard` counts decisions that were not recorded. `late`, `lost`,
    `refused`, `violations`, `outside`, `holds` and `differing` count frames in which that occurred. `unknown`
    counts frames that were not compared because a frame before them, and so the memory, is not known. After
    each span of `damaged` the interpreter continued from the next memory in the recording; `forgotten` counts
    the frames up to it, which were not compared. `undecided` counts later decisions of actuators with
    `on_loss degrade`, which depend on memory without lost clients that is not in the recording.
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
