"""A run of an experiment, held against the reference interpreter: every frame must be decided alike.

Experiments run generated Python for its speed. An audit lets the interpreter, which executes the program
wire by wire as it was written, decide on the same readings in lockstep, bit for bit
(`verify/testing/agreement.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

from colony.experiment.behavior import behavior_of
from colony.experiment.record import RunKey
from colony.experiment.runs import Run, RunSpec
from colony.ir.frame import Frame, Outcome
from colony.robots.variants import VARIANTS
from colony.verify.reference.interpreter import Interpreter


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditedRun:
    """The number of frames compared in a run, and how the first different one differs; "" if none does."""

    key: RunKey
    frames: int
    difference: str


class _DifferenceError(Exception):
    """A frame was decided otherwise."""


def audit(spec: RunSpec) -> AuditedRun:
    """Drive a run with both, to its end or to the first frame in which they differ."""
    interpreter = Interpreter(behavior_of(VARIANTS[spec.key.variant.partition("/")[0]].behavior).program)

    def compare(frame: Frame, outcome: Outcome) -> None:
        expected = interpreter.step(frame)
        if repr(outcome) != repr(expected):
            at = f"run {spec.key.number}, seed {spec.key.seed}, frame at {frame.t_ns / 1e9:.2f} s"
            raise _DifferenceError(
                f"{at}: expected {expected}, found {outcome}; the readings are {dict(frame.readings)}"
            )

    run = Run(spec, watch=compare)
    difference = ""
    try:
        while run.step():
            pass
    except _DifferenceError as found:
        difference = str(found)
    finally:
        run.close()
    return AuditedRun(key=spec.key, frames=run.loop.k, difference=difference)


def audited(spec: RunSpec, part: float) -> bool:
    """Return True if a run belongs to the audited ones, a fixed `part` of all."""
    number = spec.key.number * 2_654_435_761 + spec.key.seed * 40_503 + 97
    return (number % 10_007) / 10_007 < part
