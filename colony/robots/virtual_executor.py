"""The runtime as an executor: servers and clients exchange messages in virtual time."""

from __future__ import annotations

from colony.compile.pipeline import Compilation
from colony.ir.frame import Decision, Frame, Outcome
from colony.robots.scripted import ScriptedRobot
from colony.runtime.assembly.virtual import RUN
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Tick
from colony.runtime.transport.virtual import VirtualClock

_TRACE_GAP_NS = 1_000_000_000
"""Nanoseconds from the last frame of a trace to the first one of the next."""


_LATEST_NS = 2**61
"""Latest start of an epoch in nanoseconds; message times have 63 bits."""


class VirtualExecutor:
    """An executor that runs a program with its clients over a perfect transport (an `ir.frame.Executor`).

    One run of the robot executes all traces. Each trace is an epoch that begins with a reset of all memory,
    as after a loss during a run. Messages at the same time arrive in an order drawn from `seed`, which must
    not affect the outcome; with `isolate` each client is a process of its own. Mutable.

    Raises:
        DiagnosticError: a Python module cannot be imported or built.
        DecisionError: in `step`, if the runtime does not decide a frame, or its monitor reports a violation.
    """

    def __init__(self, compilation: Compilation, *, seed: int = 0, isolate: bool = False) -> None:
        self._compiled, self._seed, self._isolate = compilation.compiled, seed, isolate
        self._actuators = tuple(a.name for a in self._compiled.robot.actuators)
        self._begin()

    def _begin(self) -> None:
        self._frame = Frame(0, {})
        self._clock = VirtualClock()
        self._robot = ScriptedRobot(
            self._compiled,
            lambda tick: self._frame.readings,
            clock=self._clock,
            seed=self._seed,
            ticking=False,
            isolate=self._isolate,
        )
        self._transport = self._robot.transport
        self._robot.start()
        self._k, self._start = -1, 0
        self._offset_ns: int | None = None  # the robot's time minus the trace's

    def restart(self) -> None:
        """Begin a new epoch with the next frame, or a new run before times exceed the range of messages."""
        if self._clock.now_ns > _LATEST_NS:
            self._begin()
        self._start, self._offset_ns = self._k + 1, None

    def step(self, frame: Frame) -> Outcome:
        """Decide one frame."""
        if self._offset_ns is None:
            self._offset_ns = self._clock.now_ns + _TRACE_GAP_NS - frame.t_ns
        t_ns = frame.t_ns + self._offset_ns
        self._frame = frame
        self._k += 1
        self._transport.run_until(t_ns)
        tick = Tick(k=self._k, t_ns=t_ns, start=self._start, run=RUN, restarted=frame.restarted)
        self._transport.inject(topics.TICKS, tick)
        self._transport.run_until(t_ns + 1)
        return self._outcome(self._take_log())

    def _take_log(self) -> RunFrame:
        logs = self._robot.log.frames
        current = next((log for log in logs if log.tick.k == self._k), None)
        logs.clear()
        self._robot.sent.clear()
        if current is None:
            raise DecisionError("the frame was not decided although no message was late")
        return current

    def _outcome(self, log: RunFrame) -> Outcome:
        problems = list(log.disagreements)
        problems += [
            f"{name}: {'; '.join(v.notes) or 'two clients were active'}"
            for name, v in log.verdicts.items()
            if v.violation or v.notes
        ]
        if problems:
            raise DecisionError("; ".join(problems))
        verdicts = [log.verdicts[name] for name in self._actuators]
        decisions = tuple(Decision(v.actuator, v.by, v.values, v.fault) for v in verdicts)
        return log.expected._replace(decisions=decisions)


class DecisionError(Exception):
    """The runtime did not decide a frame correctly; the message has the details."""
