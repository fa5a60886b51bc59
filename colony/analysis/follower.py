"""Following a run, frame by frame, so that any of its frames can be explained."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from colony.analysis.audit import Recorded, RecordedTick
from colony.analysis.resuming import Resuming
from colony.ir.given import given_in_frame
from colony.ir.program import Program, PythonModule, Sensor, modules_that_can_be_lost
from colony.verify.explain.causes import Absence
from colony.verify.explain.history import NO_HISTORY, Historian, History
from colony.verify.explain.moment import Moment, moment_of
from colony.verify.reference.boundary import FUTURE, age_checked
from colony.verify.reference.interpreter import Interpreter
from colony.verify.reference.memory import InterpreterState


class FollowedTick(RecordedTick, Protocol):
    """The identity of a frame, its lost clients, and the servers that did not live."""

    @property
    def down(self) -> Sequence[str]:
        """The servers that were down."""
        ...


class Followed(Recorded, Protocol):
    """A frame of a run, from a recording or from an observer."""

    @property
    def tick(self) -> FollowedTick:
        """The identity of the frame."""
        ...


class Checkpoint(NamedTuple):
    """All that a follower remembers after a frame: the state of its interpreter, and the history.

    `state` is None where memory is initial, and `is_known` false where it is not known.
    """

    state: InterpreterState | None
    is_known: bool
    history: History


class Follower:
    """Follows a run in the reference interpreter. Stateful: holds the interpreter, and the history.

    Take every frame of the run, in order, from a recording or from an observer. `moment` is then the last
    frame, to be explained; it is None where memory is not known: after damage or a frame that was missed, or
    where a recording begins in the middle of an epoch.
    Modules in Python are not run: frames have their answers.
    """

    def __init__(self, program: Program, checkpoint: Checkpoint | None = None) -> None:
        self._program = program
        self._actuators = program.robot.actuators
        self._python = frozenset(m.name for m in program.modules if isinstance(m, PythonModule))
        self._can_be_lost = frozenset(modules_that_can_be_lost(program))
        self._resuming = Resuming(program, answers_given=True)
        self._historian = Historian(program, checkpoint.history if checkpoint else NO_HISTORY)
        self._interpreter: Interpreter | None = None  # before the first frame, memory is not known
        self._is_first = self._historian.history == NO_HISTORY
        self.moment: Moment | None = None
        if checkpoint is not None and checkpoint.is_known:
            self._interpreter = Interpreter(program, answers_given=True)
            if checkpoint.state is not None:
                self._interpreter.restore(checkpoint.state)

    @property
    def checkpoint(self) -> Checkpoint:
        """All that must be known to go on after the last frame."""
        interpreter = self._interpreter
        return Checkpoint(
            None if interpreter is None else interpreter.state,
            interpreter is not None,
            self._historian.history,
        )

    @property
    def interpreter(self) -> Interpreter | None:
        """The interpreter, which has stepped over the last frame; None if its memory is not known."""
        return self._interpreter

    def take(self, recorded: Followed) -> Moment | None:
        """Take the next frame of the run; return it as a moment, None if its memory is not known."""
        tick = recorded.tick
        if recorded.restart or tick.k == tick.start:
            self._restart()
        elif recorded.damaged or recorded.memory_unknown:
            self._interpreter = None
        if self._interpreter is None and recorded.keyframe is not None and not recorded.memory_unknown:
            self._resume(recorded)
        if self._interpreter is None or not self._python <= recorded.answers.keys():
            self._interpreter, self.moment = None, None
        else:
            self.moment = self._moment(self._interpreter, recorded)
        self._is_first = False
        return self.moment

    def _restart(self) -> None:
        self._interpreter = Interpreter(self._program, answers_given=True)

    def _resume(self, recorded: Followed) -> None:
        self._historian, self._is_first = Historian(self._program), True
        memory = None if recorded.keyframe is None else recorded.keyframe.memory
        if memory is None:
            return
        try:
            self._interpreter = self._resuming.interpreter(memory)
        except ValueError:
            self._interpreter = None

    def _moment(self, interpreter: Interpreter, recorded: Followed) -> Moment:
        before, earlier = interpreter.state, self._historian.history
        given = given_in_frame(self._actuators, recorded.verdicts)
        lost = self._can_be_lost.intersection(address.partition("/")[2] for address in recorded.tick.lost)
        outcome = interpreter.step(recorded.frame, lost, recorded.answers, given)
        decisions = tuple(
            interpreter.network_decision(next(a for a in self._actuators if a.name == d.actuator))
            if d.actuator in given
            else d
            for d in outcome.decisions
        )
        outcome = outcome._replace(decisions=decisions)
        winners = {
            d.actuator: verdict.by if (verdict := recorded.verdicts.get(d.actuator)) is not None else d.by
            for d in decisions
        }
        after = interpreter.state
        assert after is not None, "a frame was decided"
        history = self._historian.take(interpreter, after.memory.functions, winners, first=self._is_first)
        return moment_of(
            self._program,
            interpreter,
            before,
            history,
            k=recorded.tick.k,
            frame=recorded.frame,
            outcome=outcome,
            absent=_absent(self._program, interpreter, recorded),
            earlier=earlier,
            answers=recorded.answers,
            verdicts=recorded.verdicts,
            lost=lost,
        )


def _absent(program: Program, interpreter: Interpreter, recorded: Followed) -> dict[str, Absence]:
    """Return the sensors without a reading, each with the reason."""
    fresh = interpreter.values.fresh
    return {s.name: _absence(s, recorded) for s in program.robot.sensors if s.name not in fresh}


def _absence(sensor: Sensor, recorded: Followed) -> Absence:
    if sensor.server in recorded.tick.down:
        return "server down"
    reading = recorded.frame.readings.get(sensor.name)
    if reading is None:
        return "no reading"
    checked = age_checked(sensor, reading, recorded.frame)
    if checked is None:
        return "too old"
    return "from the future" if checked is FUTURE else "faulty"
