"""What an audit comes to: data, as `colony audit --format json` gives it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from colony.ir.frame import Decision

Part = Literal["wins", "active", "inactive", "silent"]
"""What a client does by the interpreter: it wins, its predicate holds but it does not get through, or not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientAccount:
    """A client in the frame that differs: what was recorded of it, if anything was, and what is right."""

    client: str
    fate: str | None
    part: Part


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A frame that was not as the interpreter says; frame `index` of the recording.

    `actuator` is None, and so are the decisions, where it is not about an actuator. `missing` are sensors
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
    """A part of the recording that is damaged: the times of the whole frames around it, None at its ends."""

    after_ns: int | None
    before_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditReport:
    """What an audit came to.

    `compared` counts decisions (one an actuator and frame), `idled` those among them that were idle because a
    client was late, lost or refused; `unheard` those that nothing was recorded of. `late`, `lost`, `refused`,
    `violations`, `outside`, `holds` and `differing` count frames in which that occurred, `unknown` those that
    were not compared because a frame before them, and so memory, is not known. After each of `damaged` the
    interpreter went on from the memory that the recording holds; `forgotten` counts the frames until there
    was one, which were not compared. `undecided` counts decisions of actuators with `on_loss degrade` after
    it, of which it is not known what lost clients had changed.
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
        """Whether every frame was as the interpreter says."""
        return self.first is None

    def as_json(self) -> dict[str, object]:
        """Return the report as plain dicts and lists."""
        out: dict[str, Any] = {"agrees": self.agrees, **asdict(self)}
        if self.first is not None:
            for name, decision in (("recorded", self.first.recorded), ("expected", self.first.expected)):
                out["first"][name] = None if decision is None else decision._asdict()
        return out
