"""The interpreter along a run: it steps over every frame whose memory is known, and resumes after gaps."""

from __future__ import annotations

from colony.ir.frame import Outcome
from colony.ir.given import given_in_frame
from colony.ir.program import Program, PythonModule
from colony.verify.audit.resuming import Resuming
from colony.verify.reference.interpreter import Interpreter
from colony.watch.snapshot import ObservedFrame, Snapshot, SnapshotMaker


class Stepper:
    """Makes the snapshots of a run, frame by frame. Stateful: holds the interpreter.

    It runs no module in Python, and takes their recorded answers.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._python = frozenset(m.name for m in program.modules if isinstance(m, PythonModule))
        self._resuming = Resuming(program, answers_given=True)
        self._interpreter: Interpreter | None = None
        self._maker: SnapshotMaker | None = None

    def step(self, observed: ObservedFrame) -> Snapshot:
        """Return the snapshot of the next frame."""
        if self._maker is None:
            self._maker = SnapshotMaker(self._program, observed.frame.t_ns)
        outcome = self._outcome(observed)
        return self._maker.make(observed, outcome, self._interpreter)

    def _outcome(self, observed: ObservedFrame) -> Outcome | None:
        tick = observed.tick
        if observed.damaged:
            self._interpreter = None
        if observed.restart or observed.frame.restarted or tick.k == tick.start:
            self._interpreter = Interpreter(self._program, answers_given=True)
        elif observed.memory_unknown and observed.keyframe is None:
            self._interpreter = None
        elif self._interpreter is None and observed.keyframe is not None:
            self._resume(observed)
        if not self._python <= observed.answers.keys():
            self._interpreter = None
        if self._interpreter is None:
            return None
        given = given_in_frame(self._program.robot.actuators, observed.verdicts)
        return self._interpreter.step(observed.frame, answers=observed.answers, given=given)

    def _resume(self, observed: ObservedFrame) -> None:
        keyframe = observed.keyframe
        if keyframe is None or keyframe.memory is None:
            return
        try:
            self._interpreter = self._resuming.interpreter(keyframe.memory)
        except ValueError:  # memory of another program
            self._interpreter = None
