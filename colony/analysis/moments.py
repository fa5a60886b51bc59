"""Following a run, frame by frame, so that any of its frames can be explained."""

from __future__ import annotations

from typing import NamedTuple

from colony.analysis.follower import DamagedSpan, Follower, Interpreters, UnknownMemory, step_given
from colony.ir.program import Program, Sensor, modules_that_can_be_lost
from colony.runtime.frames.run_frame import RunFrame
from colony.verify.explain.causes import Absence
from colony.verify.explain.moment import NO_HISTORY, Historian, History, Moment, moment_of
from colony.verify.reference.boundary import FUTURE, age_checked
from colony.verify.reference.interpreter import Interpreter
from colony.verify.reference.memory import InterpreterState


class FollowerCheckpoint(NamedTuple):
    """All that a follower remembers after a frame: the state of its interpreter, and the history.

    `state` is None where memory is initial, and `is_known` false where it is not known.
    """

    state: InterpreterState | None
    is_known: bool
    history: History


class MomentFollower:
    """Follows a run, and remembers since when things are as they are. Stateful.

    Take every frame of the run, in order, from a recording or from an observer. `moment` is then the last
    frame, to be explained; it is None where memory is not known.
    """

    def __init__(
        self,
        program: Program,
        checkpoint: FollowerCheckpoint | None = None,
        interpreters: Interpreters | None = None,
    ) -> None:
        self._program = program
        self._can_be_lost = frozenset(modules_that_can_be_lost(program))
        interpreters = interpreters or Interpreters(program)
        interpreter = interpreters.begin() if checkpoint is not None and checkpoint.is_known else None
        if interpreter is not None and checkpoint is not None and checkpoint.state is not None:
            interpreter.restore(checkpoint.state)
        self._follower = Follower(interpreters, interpreter)
        self._historian = Historian(program, checkpoint.history if checkpoint else NO_HISTORY)
        self._is_first = self._historian.history == NO_HISTORY
        self.moment: Moment | None = None

    @property
    def checkpoint(self) -> FollowerCheckpoint:
        """All that must be known to go on after the last frame."""
        interpreter = self.interpreter
        state = None if interpreter is None else interpreter.state
        return FollowerCheckpoint(state, interpreter is not None, self._historian.history)

    @property
    def interpreter(self) -> Interpreter | None:
        """The interpreter, which has stepped over the last frame; None if its memory is not known."""
        return self._follower.executor

    @property
    def damaged(self) -> list[DamagedSpan]:
        """The damaged sections."""
        return self._follower.damaged

    def take(self, frame: RunFrame) -> Moment | None:
        """Take the next frame of the run; return it as a moment, None if its memory is not known."""
        interpreter = self._follower.feed(frame)
        if self._follower.has_resumed:
            self._historian, self._is_first = Historian(self._program), True
        self.moment = None if isinstance(interpreter, UnknownMemory) else self._moment(interpreter, frame)
        self._is_first = False
        return self.moment

    def end(self, *, damaged: bool) -> None:
        """If `damaged`, record that the recording is damaged after its last frame."""
        self._follower.end(damaged=damaged)

    def _moment(self, interpreter: Interpreter, frame: RunFrame) -> Moment:
        before, earlier = interpreter.state, self._historian.history
        lost = self._can_be_lost.intersection(address.partition("/")[2] for address in frame.tick.lost)
        outcome = step_given(interpreter, frame, lost)
        winners = {
            d.actuator: verdict.by if (verdict := frame.verdicts.get(d.actuator)) is not None else d.by
            for d in outcome.decisions
        }
        after = interpreter.state
        assert after is not None, "a frame was decided"
        history = self._historian.take(interpreter, after.memory.functions, winners, first=self._is_first)
        return moment_of(
            self._program,
            interpreter,
            before,
            history,
            k=frame.tick.k,
            frame=frame.frame,
            outcome=outcome,
            absent=_absent(self._program, interpreter, frame),
            earlier=earlier,
            answers=frame.answers,
            verdicts=frame.verdicts,
            lost=lost,
        )


def _absent(program: Program, interpreter: Interpreter, frame: RunFrame) -> dict[str, Absence]:
    """Return the sensors without a reading, each with the reason."""
    fresh = interpreter.values.fresh
    return {s.name: _absence(s, frame) for s in program.robot.sensors if s.name not in fresh}


def _absence(sensor: Sensor, frame: RunFrame) -> Absence:
    if sensor.server in frame.tick.down:
        return "server down"
    reading = frame.frame.readings.get(sensor.name)
    if reading is None:
        return "no reading"
    checked = age_checked(sensor, reading, frame.frame)
    if checked is None:
        return "too old"
    return "from the future" if checked is FUTURE else "faulty"
