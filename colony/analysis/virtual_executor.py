"""The runtime as an executor under test: in virtual time over a perfect transport, or with faults.

With faults, processes die, freeze and restart; messages are lost, delayed or duplicated. Every command that
leaves arbitration must be the reference interpreter's for that frame, or the idle one. The frames are
reconstructed from the network traffic: the frames that servers published, and the Clock's ticks. Within an
epoch they are consecutive, and the interpreter restarts with each epoch. If a server died while sending a
frame, only some clients may have received that frame before the Clock declared it void. Commands that
follow from the epoch with or without the frame are then accepted until a new epoch begins.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from random import Random

from colony.compile.pipeline import Compilation
from colony.execute.compiled import Compiled
from colony.ir.frame import Decision, Frame, Outcome, Reading
from colony.ir.program import Actuator, Program, in_declared_units
from colony.ir.servers import DSERVER
from colony.runtime.assembly.scripted import SCRIPTED_SERVERS, ScriptedRobot, SentCommand
from colony.runtime.assembly.virtual import RUN
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Message, ServerFrame, Tick
from colony.runtime.protocol.topics import activity, module_of
from colony.runtime.transport.exchange import Delay
from colony.runtime.transport.faults import FaultRates, LinkFaults
from colony.runtime.transport.virtual import VirtualClock
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import Disagreement

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


# --- faults ------------------------------------------------------------------------------------------


MS = 1_000_000
FRAMES = 24
"""Number of frames of a run."""

FAULTLESS_FRAMES = 4
"""Number of frames without faults at the end of a run."""


def with_faults(compilation: Compilation, trace: Sequence[Frame], seed: int) -> Disagreement | None:
    """Run a program over the readings of `trace`, cyclically, with faults from `seed`.

    Frames are longer than in the program, so that losses become visible within a few of them.
    """
    random = Random(seed)
    frame_ns = random.choice((250, 250, 100)) * MS
    faulty_run = _FaultyRun(replace(compilation.compiled, frame_ns=frame_ns), trace, seed, random)
    try:
        faulty_run.run()
    except Exception as raised:  # any exception of a process is a finding
        frame = Frame(faulty_run.now_ns, {})
        found = f"a process raised {type(raised).__name__}: {raised}"
        return Disagreement(executor="", trace=(frame,), expected=Outcome(()), found=found)
    return _first_disagreement(compilation.program, faulty_run)


# --- the run ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Traffic:
    """The recorded network traffic."""

    ticks: dict[int, Tick] = field(default_factory=dict)
    frames: dict[tuple[str, int], ServerFrame] = field(default_factory=dict)
    void: set[tuple[str, int]] = field(default_factory=set)

    def record(self, message: Message) -> None:
        match message:
            case Tick():
                self.ticks.setdefault(message.k, message)
                self.void.update(message.void)
            case ServerFrame() if message.server in SCRIPTED_SERVERS:
                self.frames.setdefault((message.server, message.k), message)
            case _:
                pass


class _FaultyRun:
    """A run with faults. Mutable: `traffic` grows during the run."""

    def __init__(self, compiled: Compiled, trace: Sequence[Frame], seed: int, random: Random) -> None:
        self._frame_ns = compiled.frame_ns
        self._faulty_ns = (FRAMES - FAULTLESS_FRAMES) * self._frame_ns
        self.traffic = _Traffic()
        self._clock = VirtualClock()
        self._faults = self._link(seed, random)
        self.robot = ScriptedRobot(
            compiled,
            lambda tick: trace[tick.k % len(trace)].readings,
            clock=self._clock,
            seed=seed,
            link=self._record_and_delay,
        )
        self.robot.start()
        self._schedule_failures(random)

    @property
    def now_ns(self) -> int:
        return self._clock.now_ns

    def run(self) -> None:
        self.robot.transport.run_until(FRAMES * self._frame_ns)
        self.robot.observer.close()

    def _link(self, seed: int, random: Random) -> LinkFaults:
        """Return faults that end before the faultless frames, and never affect messages to the observer."""
        scale = random.choice((0.0, 0.3, 1.0, 2.0))
        rates = FaultRates(
            lost=0.02 * scale, duplicated=0.02 * scale, late=0.03 * scale, reordered=0.1 * scale
        )

        def is_exempt(sender: str, receiver: str, message: Message) -> bool:
            return receiver == self.robot.observer.address or self._clock.now_ns >= self._faulty_ns

        return LinkFaults(seed, rates, exempt=is_exempt)

    def _record_and_delay(self, sender: str, receiver: str, message: Message) -> Delay:
        self.traffic.record(message)
        return self._faults(sender, receiver, message)

    def _schedule_failures(self, random: Random) -> None:
        """Schedule the death or freeze of some processes, and their return."""
        addresses = self.robot.processes
        for _ in range(random.choice((0, 1, 1, 2, 3, 5))):
            address = random.choice(addresses)
            death_ns = random.randrange(self._faulty_ns)
            return_ns = min(self._faulty_ns, death_ns + random.choice((0, 30, 200, 600, 1500, 4000)) * MS)
            fail = self.robot.kill if random.random() < 0.6 else self.robot.freeze
            self.robot.transport.at(death_ns, partial(fail, address))
            self.robot.transport.at(return_ns, partial(self.robot.revive, address))


# --- the expected behavior ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _ReferenceRun:
    """The frames of an epoch, and the reference interpreter's outcomes."""

    frames: tuple[Frame, ...]
    outcomes: tuple[Outcome, ...]


def _first_disagreement(program: Program, faulty_run: _FaultyRun) -> Disagreement | None:
    """Return the first command that the reference would not have sent, or the monitor's first finding."""
    actuators = {a.name: a for a in program.robot.actuators}
    sent: dict[int, list[SentCommand]] = {}
    for command in faulty_run.robot.sent:
        sent.setdefault(command.k, []).append(command)
    reference_runs: dict[int, tuple[_ReferenceRun, int, frozenset[str]]] = {}
    for epoch in _epochs(faulty_run.traffic.ticks):
        candidates = [_reference_run(program, faulty_run.traffic, epoch, void_counts=True)]
        if any(
            (s, t.k) in faulty_run.traffic.void & faulty_run.traffic.frames.keys()
            for t in epoch
            for s in SCRIPTED_SERVERS
        ):
            candidates.append(_reference_run(program, faulty_run.traffic, epoch, void_counts=False))
        unpredictable = _unpredictable_actuators(faulty_run, actuators.values(), epoch)
        for i, tick in enumerate(epoch):
            reference_runs[tick.k] = candidates[0], i, unpredictable
            for command in sent.get(tick.k, ()):
                if command.actuator in unpredictable:
                    continue
                expected = [
                    d for p in candidates for d in p.outcomes[i].decisions if d.actuator == command.actuator
                ]
                if not _is_allowed(command, expected, actuators[command.actuator]):
                    return _disagreement(
                        candidates[0], i, f"{command.actuator}: {_command_text(command)} left arbitration"
                    )
    for log in faulty_run.robot.log.frames:
        if log.tick.k in reference_runs:
            reference_run, i, unpredictable = reference_runs[log.tick.k]
            contradictions = [
                text for text in log.disagreements if text.partition(":")[0] not in unpredictable
            ]
            if contradictions:
                return _disagreement(reference_run, i, f"the monitor says {'; '.join(contradictions)}")
    return None


def _unpredictable_actuators(
    faulty_run: _FaultyRun, actuators: Iterable[Actuator], epoch: list[Tick]
) -> frozenset[str]:
    """Return the actuators whose expected commands are unknown.

    With `on_loss degrade`, a Python module without a known answer counts as inactive for other clients. The
    expected command is therefore unknown if an announcer or DServer was down.
    """
    sources = {
        DSERVER.name,
        *(activity(DSERVER.name, module) for module in faulty_run.robot.deployed.python_modules),
    }
    is_unpredictable = faulty_run.robot.deployed.python_modules and any(
        sources & set(tick.down) for tick in epoch
    )
    return frozenset(a.name for a in actuators if is_unpredictable and a.on_loss == "degrade")


def _epochs(ticks: Mapping[int, Tick]) -> Iterator[list[Tick]]:
    """Yield the ticks of the run, epoch by epoch, without those that a restarted Clock abandoned."""
    by_start: dict[int, list[Tick]] = {}
    for k in sorted(ticks):
        if ticks[k].run:
            by_start.setdefault(ticks[k].start, []).append(ticks[k])
    for epoch in by_start.values():
        gaps = {gap for tick in epoch for gap in tick.gaps}
        yield [tick for tick in epoch if not any(last < tick.k < first for last, first in gaps)]


def _reference_run(
    program: Program, traffic: _Traffic, epoch: list[Tick], *, void_counts: bool
) -> _ReferenceRun:
    """Return the reference's outcomes in an epoch; with `void_counts`, void frames are "no value"."""
    interpreter = Interpreter(program)
    degrading = any(a.on_loss == "degrade" for a in program.robot.actuators)
    sent = [sensor.name for sensor in program.robot.sensors if sensor.sent is not None]
    frames, outcomes = [], []
    for tick in epoch:
        readings: dict[str, Reading] = dict.fromkeys(sent)
        for server in SCRIPTED_SERVERS:
            key = (server, tick.k)
            if (
                server not in tick.down
                and key in traffic.frames
                and not (void_counts and key in traffic.void)
            ):
                readings |= {n: s.value for n, s in traffic.frames[key].fields.items() if s is not None}
        frames.append(Frame(tick.t_ns, readings, restarted=tick.restarted))
        lost = frozenset(map(module_of, tick.lost)) if degrading else frozenset[str]()
        outcomes.append(interpreter.step(frames[-1], lost))
    return _ReferenceRun(tuple(frames), tuple(outcomes))


def _is_allowed(command: SentCommand, expected: Sequence[Decision], actuator: Actuator) -> bool:
    if command.by is None:
        return repr(command.values) == repr(in_declared_units(actuator.idle, actuator.fields))
    return repr((command.by, command.values, command.fault)) in [
        repr((d.by, d.values, d.fault)) for d in expected
    ]


def _disagreement(reference_run: _ReferenceRun, index: int, found: str) -> Disagreement:
    return Disagreement(
        executor="",
        trace=reference_run.frames[: index + 1],
        expected=reference_run.outcomes[index],
        found=f"with faults: {found}",
    )


def _command_text(command: SentCommand) -> str:
    return f"{command.by or 'nobody'} {command.values}" + (f" ({command.fault})" if command.fault else "")
