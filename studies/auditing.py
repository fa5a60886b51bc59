"""The audit of a run: the reference interpreter must decide every frame in the same way.

Experiments run generated Python, which is fast. An audit runs the interpreter, which executes the program
wire by wire as it was written, on the same readings in lockstep, and compares bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

from colony.experiment.results import RunKey
from colony.ir.frame import Frame, Outcome
from colony.runs.behavior import behavior_of
from colony.verify.reference.interpreter import Interpreter
from studies.runs import Run, StudyRun
from studies.variants import VARIANTS


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditedRun:
    """The audit of one run: the number of compared frames, and the first difference ("" for none)."""

    key: RunKey
    frames: int
    difference: str


class _DifferenceError(Exception):
    """The interpreter decided a frame differently."""


def audit(spec: StudyRun) -> AuditedRun:
    """Drive a run with the generated program and the interpreter, to its end or the first difference."""
    interpreter = Interpreter(behavior_of(VARIANTS[spec.key.variant.partition("/")[0]].behavior).program)

    def compare(frame: Frame, outcome: Outcome) -> None:
        expected = interpreter.step(frame)
        if repr(outcome) != repr(expected):
            label = f"run {spec.key.number}, seed {spec.key.seed}, frame at {frame.t_ns / 1e9:.2f} s"
            raise _DifferenceError(
                f"{label}: expected {expected}, found {outcome}; the readings are {dict(frame.readings)}"
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


def is_audited(spec: StudyRun, fraction: float) -> bool:
    """Return True if a run is among the audited ones, a fixed `fraction` of all runs."""
    number = spec.key.number * 2_654_435_761 + spec.key.seed * 40_503 + 97
    return (number % 10_007) / 10_007 < fraction
