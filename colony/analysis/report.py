"""The result of an audit as data, in the form printed by `colony audit --format json`."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from colony.analysis.follower import DamagedSpan
from colony.ir.frame import MISSED, ActuatorOutcome, Decision, is_connection
from colony.ir.program import Actuator, in_declared_units
from colony.ir.types import ScalarValue
from colony.verify.reference.interpreter import Interpreter

# --- verdict -------------------------------------------------------------------------------------------
#
# Comparison of a verdict with a decision of the reference interpreter.


_COMMANDED = frozenset({"won", "overruled", "overridden", "locked out", "stopped"})
_GATED = frozenset({"suppressed", "inhibited"})
_NOT_ACTIVE = frozenset({"inactive", "silent"})


def objection(
    actuator: Actuator, verdict: ActuatorOutcome, expected: Decision, interpreter: Interpreter
) -> str | None:
    """Return a message about a wrong verdict of the network, or None if it is right.

    `expected` is the interpreter's decision; `interpreter` has decided the same frame.
    """
    if verdict.violation:
        return "two clients commanded in one frame"
    if not same_decision(verdict, expected):
        if not is_excused(verdict):
            return "the command sent is not the interpreter's"
        if not is_idle(actuator, verdict):
            return "a client was missing, and neither the interpreter's command nor the idle command was sent"
    clients = (f for f in verdict.fates if not is_connection(f[0]))
    return next(
        (text for text in (_fate_objection(*f, expected, interpreter) for f in clients) if text), None
    )


def outside_objection(actuator: Actuator, verdict: ActuatorOutcome, interpreter: Interpreter) -> str | None:
    """Return a message about a command from outside that the program does not allow, or None.

    It must be within the range, and within the limits of the frame, unless they do not hold for that client.
    If the command could not be sent, the actuator must be idle. `interpreter` has decided the same frame.
    """
    if verdict.outside is None:
        return None
    if verdict.fault is not None or verdict.values is None:
        idle = in_declared_units(actuator.idle, actuator.fields)
        if same_values(verdict.values, idle):
            return None
        return "a command from outside could not be sent, and the idle command was not sent"
    ranges = tuple((_or(f.low, -math.inf), _or(f.high, math.inf)) for f in actuator.fields)
    bounds = ranges if verdict.unlimited else interpreter.bounds(actuator)
    if bounds is None:
        return "a command from outside was sent in a frame whose limits allow none"
    for sent, value, (low, high) in zip(actuator.fields, verdict.values, bounds, strict=True):
        if not isinstance(value, bool) and not low / sent.factor <= value <= high / sent.factor:
            least, most = low / sent.factor, high / sent.factor
            allowed = f"at least {least:g}" if value < least else f"at most {most:g}"
            found = f"{sent.name} = {value:g} {sent.unit}; allowed: {allowed} {sent.unit}"
            return f"a command from outside is beyond the limits: found {found}"
    return None


def _or(bound: float | None, otherwise: float) -> float:
    return otherwise if bound is None else bound


def same_decision(verdict: ActuatorOutcome, expected: Decision) -> bool:
    """Return True if winner, values and fault are the same, values bit for bit."""
    same = (verdict.by, verdict.fault) == (expected.by, expected.fault)
    return same and same_values(verdict.values, expected.values)


def same_values(a: Sequence[ScalarValue] | None, b: Sequence[ScalarValue] | None) -> bool:
    """Return True if two commands are the same bit for bit: -0.0 is not 0.0."""
    if a is None or b is None:
        return a is b
    return len(a) == len(b) and all(map(_same_bits, a, b))


def _same_bits(a: ScalarValue, b: ScalarValue) -> bool:
    if isinstance(a, bool) or isinstance(b, bool):
        return a is b
    return struct.pack("<d", a) == struct.pack("<d", b)


def is_excused(verdict: ActuatorOutcome) -> bool:
    """Return True if a client was late, lost or refused."""
    return any(fate in MISSED for _, fate in verdict.fates)


def is_idle(actuator: Actuator, verdict: ActuatorOutcome) -> bool:
    """Return True if no client won and the idle command was sent (nothing, for `idle hold`)."""
    idle = in_declared_units(actuator.idle, actuator.fields)
    return verdict.by is None and verdict.fault is None and same_values(verdict.values, idle)


def _fate_objection(client: str, fate: str, expected: Decision, interpreter: Interpreter) -> str | None:
    """Return a message about a wrong fate of a client, or None if it is right."""
    wins = client == expected.by
    if fate in _COMMANDED and not wins:
        return f"`{client}` commanded, but in the interpreter it does not get through"
    if (fate in _GATED or fate in _NOT_ACTIVE) and wins:
        return f"`{client}` was {fate}, but in the interpreter it gets through"
    if fate in _GATED and not interpreter.is_active(client):
        return f"`{client}` was {fate}, but in the interpreter it is not active"
    if fate in _NOT_ACTIVE and interpreter.is_active(client):
        return f"`{client}` was {fate}, but in the interpreter it is active"
    if fate == "inactive" and interpreter.is_silent(client):
        return f"`{client}` was inactive, but in the interpreter it is silent: it reads something missing"
    return None


# --- report --------------------------------------------------------------------------------------------


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
    """A contract that the interpreter found broken in `frames` frames, the first and last at these times.

    One that is `assumed` is an assumption.
    """

    contract: str
    frames: int
    first_ns: int
    last_ns: int
    assumed: bool = False


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
