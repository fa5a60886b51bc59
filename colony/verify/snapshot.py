"""The input of the reference interpreter in one frame of a proof: readings in base units, bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from colony.ir.frame import NOTHING_GIVEN, Frame, Given
from colony.ir.program import Program
from colony.ir.types import ScalarValue, Value
from colony.verify.reference.boundary import sense

_NONE: Mapping[str, Any] = {}


class Snapshot(NamedTuple):
    """The inputs of one frame in base units; a `Frame` has them in declared units.

    Proofs need base units: a reading that is converted to its unit and back may differ in the last bit, and
    a counterexample at the edge of a comparison would then no longer break the contract.

    Attributes:
        t_ns: Time of the frame.
        readings: Value of each sensor that has one. What an actuator was given last is what the program
            itself sent, unless it has a value or None.
        answers: Command of each applicable module in Python; None for a failsafe one without an answer.
        restarted: True if memory was lost before the frame.
        given: What actuators were given that is not what the network decided.
        lost: Modules whose clients are lost, of actuators with `on_loss degrade`.
    """

    t_ns: int
    readings: Mapping[str, Value | None] = _NONE
    answers: Mapping[str, tuple[ScalarValue, ...] | None] = _NONE
    restarted: bool = False
    given: Mapping[str, Given] = NOTHING_GIVEN
    lost: frozenset[str] = frozenset()


def present_readings(program: Program, values: Mapping[str, Value | None]) -> dict[str, Value | None]:
    """Return `values` without those that are missing.

    None stays for what an actuator was given last: without it, it would be what the program itself sent.
    """
    sent = {s.name for s in program.robot.sensors if s.sent is not None}
    return {name: value for name, value in values.items() if value is not None or name in sent}


def snapshot_of(program: Program, frame: Frame) -> Snapshot:
    """Return a frame as the interpreter sees it: clamped to ranges, without faulty readings.

    Without a reading of what an actuator was given last, it is what the program itself sent.
    """
    sensors = (s for s in program.robot.sensors if s.name in frame.readings)
    sensed = {s.name: sense(s, frame.readings[s.name], s.factor)[0] for s in sensors}
    return Snapshot(frame.t_ns, present_readings(program, sensed), restarted=frame.restarted)
