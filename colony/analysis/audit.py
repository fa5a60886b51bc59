"""Comparison of a recorded run with its program: the reference interpreter evaluates every frame again.

In each frame, the command sent to an actuator must be the one that the interpreter decides, bit for bit. If a
client was late, lost or refused, it may also be the idle command and, with `on_loss degrade`, the command
that the network decides without the lost clients. If a client outside the network commanded, or the emergency
stop or a lock kept the network from deciding, the frame is counted, and what was sent from outside must be
within the limits of the frame, unless the connection ignores them. Contracts are evaluated of what was sent.
At a restart the interpreter restarts from the initial memory, as the program did. From a frame that could not
be observed to the next restart, the memory is unknown, and nothing is compared.

Modules in Python are not run: the interpreter uses their recorded answers. If an answer is missing, the
memory is unknown from there to the next restart.

Damaged parts of a recording are never compared. After them, and in a recording that begins in the middle of
an epoch, the interpreter continues from the memory in the next keyframe of the recording.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Protocol

from colony.analysis.report import (
    AuditReport,
    ClientExplanation,
    ContractCount,
    DamagedSpan,
    Difference,
    Role,
)
from colony.analysis.resuming import Resuming
from colony.analysis.verdict import (
    is_excused,
    objection,
    outside_objection,
    same_decision,
)
from colony.ir.frame import Answer, Decision, Frame, Outcome
from colony.ir.given import SentCommand, given_in_frame, is_connection
from colony.ir.memory import ProgramMemory
from colony.ir.program import Program, PythonModule
from colony.verify.reference.interpreter import Interpreter


class RecordedTick(Protocol):
    """The identity of a frame, and its lost clients."""

    @property
    def k(self) -> int:
        """The number of the frame."""
        ...

    @property
    def start(self) -> int:
        """The number of the first frame of the epoch, before which all memory was reset."""
        ...

    @property
    def previous(self) -> int:
        """The number of the frame before this one, which is not `k` - 1 after a restart of the Clock."""
        ...

    @property
    def lost(self) -> Sequence[str]:
        """The addresses (`actuator/module`) of the lost clients."""
        ...


class RecordedMemory(Protocol):
    """The memory before a frame."""

    @property
    def memory(self) -> ProgramMemory | None:
        """The memory, or None if it is not known."""
        ...

    @property
    def degraded(self) -> bool:
        """True if a client has been lost since the beginning of the epoch."""
        ...


class Recorded(Protocol):
    """One frame of a run, from a recording or from an observed run."""

    @property
    def tick(self) -> RecordedTick:
        """The identity of the frame, and its lost clients."""
        ...

    @property
    def frame(self) -> Frame:
        """The time and the readings of the frame."""
        ...

    @property
    def verdicts(self) -> Mapping[str, SentCommand]:
        """The verdict on each actuator."""
        ...

    @property
    def restart(self) -> bool:
        """True if all memory was reset before this frame."""
        ...

    @property
    def skipped(self) -> int:
        """The number of frames directly before this one that could not be observed."""
        ...

    @property
    def memory_unknown(self) -> bool:
        """True if the memory before this frame is not known."""
        ...

    @property
    def breaches(self) -> tuple[str, ...] | None:
        """The contracts found broken, or None if that was not recorded."""
        ...

    @property
    def keyframe(self) -> RecordedMemory | None:
        """The memory before this frame, or None if it was not recorded."""
        ...

    @property
    def damaged(self) -> bool:
        """True if the recording is damaged between the previous frame and this one."""
        ...

    @property
    def answers(self) -> Mapping[str, Answer]:
        """The answers of modules in Python, as far as they are known."""
        ...


class Recording(Protocol):
    """A recording to be read."""

    def frames(self, program: Program) -> Iterator[Recorded]:
        """Yield the recorded frames."""
        ...

    @property
    def damaged(self) -> bool:
        """True if damage follows the last frame (once all frames are read)."""
        ...


def audit_recording(
    program: Program, recording: Recording, progress: Callable[[], None] = lambda: None
) -> AuditReport:
    """Compare a recording with the reference interpreter; `progress` is called after each frame.

    Raises:
        DiagnosticError: the recording is of another program.
    """
    auditor = Auditor(program)
    for recorded in recording.frames(program):
        auditor.take(recorded)
        progress()
    if recording.damaged:
        auditor.end_damaged()
    return auditor.report()


def audit(program: Program, frames: Iterable[Recorded]) -> AuditReport:
    """Compare a run with the reference interpreter; `frames` must begin with the first one."""
    auditor = Auditor(program)
    for recorded in frames:
        auditor.take(recorded)
    return auditor.report()


# --- the audit in progress ---------------------------------------------------------------------------


_COUNTERS = (
    *("frames", "compared", "idled", "unheard", "late", "lost", "refused", "violations", "outside", "holds"),
    *("restarts", "unknown", "differing", "forgotten", "resumed", "undecided"),
)
"""The counts of an `AuditReport`, which defines each of them."""


class Auditor:
    """An audit in progress, frame by frame. Stateful: holds the interpreters, and counters."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._actuators = {a.name: a for a in program.robot.actuators}
        self._clients = {
            a: tuple(m.name for m in program.modules if m.actuator == a) for a in self._actuators
        }
        self._python = frozenset(m.name for m in program.modules if isinstance(m, PythonModule))
        self._reset_memory()
        self._previous: Recorded | None = None
        self._first_ns = 0
        self._counts: Counter[str] = Counter()
        self._unheard_by_server: Counter[str] = Counter()
        self._contracts: dict[str, ContractCount] = {}
        self._first: Difference | None = None
        self._damaged: list[DamagedSpan] = []
        self._resuming = Resuming(program, answers_given=True)

    def _reset_memory(self) -> None:
        """Start an epoch, with all memory reset."""
        self._interpreter = Interpreter(self._program, answers_given=True)
        degrades = any(a.on_loss == "degrade" for a in self._program.robot.actuators)
        self._degraded = Interpreter(self._program, answers_given=True) if degrades else None
        self._memory_unknown = False

    def _resume(self, keyframe: RecordedMemory) -> None:
        """Continue from the recorded memory, if it is known and belongs to this program."""
        if keyframe.memory is None:
            return
        try:
            interpreter = self._resuming.interpreter(keyframe.memory)
        except ValueError:
            return
        self._reset_memory()
        self._interpreter = interpreter
        if self._degraded is not None:
            is_known = not keyframe.degraded  # a keyframe has no memory without the lost clients
            self._degraded = self._resuming.interpreter(keyframe.memory) if is_known else None
        self._counts["resumed"] += 1

    def take(self, recorded: Recorded) -> None:
        """Compare one frame, and count it."""
        tick, previous = recorded.tick, self._previous
        is_epoch_start = recorded.restart or tick.k == tick.start
        if recorded.damaged:
            after_ns = None if previous is None else previous.frame.t_ns
            self._damaged.append(DamagedSpan(after_ns=after_ns, before_ns=recorded.frame.t_ns))
            self._memory_unknown = True
        if previous is None:
            self._first_ns = recorded.frame.t_ns
            self._memory_unknown = self._memory_unknown or not is_epoch_start
        if is_epoch_start and (previous is not None or recorded.damaged):
            self._reset_memory()
        elif self._memory_unknown and recorded.keyframe is not None:
            self._resume(recorded.keyframe)
        differences = [*self._sequence_faults(recorded, is_epoch_start)]
        has_all_answers = self._python <= recorded.answers.keys()
        self._memory_unknown = self._memory_unknown or not has_all_answers
        if recorded.memory_unknown or not has_all_answers:
            self._counts["unknown"] += 1
        elif self._memory_unknown:
            self._counts["forgotten"] += 1
        else:
            differences += self._decisions(recorded)
        self._first = self._first or next(iter(differences), None)
        fates = {fate for v in recorded.verdicts.values() for _, fate in v.fates}
        self._counts.update(fates & {"late", "lost", "refused"})
        self._counts["violations"] += any(v.violation for v in recorded.verdicts.values())
        self._counts["outside"] += any(v.outside is not None for v in recorded.verdicts.values())
        self._counts["holds"] += any(v.hold is not None for v in recorded.verdicts.values())
        self._counts["restarts"] += is_epoch_start and previous is not None
        self._counts["differing"] += bool(differences)
        self._counts["frames"] += 1
        self._previous = recorded

    def end_damaged(self) -> None:
        """Record that the recording is damaged after its last frame."""
        after_ns = None if self._previous is None else self._previous.frame.t_ns
        self._damaged.append(DamagedSpan(after_ns=after_ns, before_ns=None))

    def report(self) -> AuditReport:
        """Return the report on the frames so far."""
        return AuditReport(
            **{name: self._counts[name] for name in _COUNTERS},
            first_ns=self._first_ns,
            last_ns=self._previous.frame.t_ns if self._previous else 0,
            first=self._first,
            contracts=tuple(
                self._contracts[c.name] for c in self._program.contracts if c.name in self._contracts
            ),
            damaged=tuple(self._damaged),
            unheard_by_server=dict(self._unheard_by_server),
        )

    def _sequence_faults(self, recorded: Recorded, is_epoch_start: bool) -> Iterator[Difference]:
        """Yield faults in the sequence of frames: memory needs every frame since the epoch began."""
        tick, previous = recorded.tick, self._previous
        if previous is None:
            return
        gap = tick.k - previous.tick.k - 1
        is_expected = gap >= recorded.skipped > 0 or tick.previous == previous.tick.k
        if gap < 0 or not (is_expected or is_epoch_start or recorded.damaged):
            missing = f": {gap} between them are not in the recording" if gap > 0 else ""
            message = f"frame {tick.k} follows frame {previous.tick.k}{missing}"
            yield self._difference(recorded, message)
        if tick.start != previous.tick.start and not (
            is_epoch_start or recorded.memory_unknown or recorded.damaged
        ):
            yield self._difference(recorded, f"a new epoch began with frame {tick.start}, which is missing")
        if recorded.frame.t_ns <= previous.frame.t_ns:
            message = f"time must increase: {recorded.frame.t_ns} ns follows {previous.frame.t_ns} ns"
            yield self._difference(recorded, message)

    def _decisions(self, recorded: Recorded) -> Iterator[Difference]:
        """Decide the frame, and yield the differences of verdicts and broken contracts."""
        given = given_in_frame(self._actuators.values(), recorded.verdicts)
        outcome = self._interpreter.step(recorded.frame, answers=recorded.answers, given=given)
        expected: dict[str, tuple[Decision, Interpreter]] = {
            d.actuator: (
                self._interpreter.network_decision(self._actuators[d.actuator]) if d.actuator in given else d,
                self._interpreter,
            )
            for d in outcome.decisions
        }
        if self._degraded is not None:
            lost = frozenset(address.partition("/")[2] for address in recorded.tick.lost)
            for decision in self._degraded.step(recorded.frame, lost, recorded.answers).decisions:
                if self._actuators[decision.actuator].on_loss == "degrade":
                    expected[decision.actuator] = decision, self._degraded
        for name, (decision, interpreter) in expected.items():
            if self._degraded is None and self._actuators[name].on_loss == "degrade":
                self._counts["undecided"] += 1  # memory without the lost clients is not known
                continue
            yield from self._compare(recorded, name, decision, interpreter)
        self._count_breaches(recorded.frame.t_ns, outcome)
        if (
            recorded.breaches is not None
            and recorded.breaches != outcome.breaches
            and self._has_one_winner(recorded)
        ):
            found, correct = (", ".join(names) or "none" for names in (recorded.breaches, outcome.breaches))
            message = f"broken contracts: recorded {found}; in the interpreter {correct}"
            yield self._difference(recorded, message)

    def _compare(
        self, recorded: Recorded, name: str, expected: Decision, interpreter: Interpreter
    ) -> Iterator[Difference]:
        verdict, actuator = recorded.verdicts.get(name), self._actuators[name]
        if verdict is None:
            self._counts["unheard"] += 1
            self._unheard_by_server[actuator.server] += 1
            return
        if verdict.outside is not None or verdict.hold is not None:
            message = outside_objection(actuator, verdict, self._interpreter)
            if message is not None:
                sent = Decision(name, verdict.by, verdict.values, verdict.fault)
                yield self._difference(recorded, message, actuator=name, recorded=sent)
            return
        self._counts["compared"] += 1
        clients = self._clients[name]
        unknown = [c for c, _ in verdict.fates if c not in clients and not is_connection(c)]
        if unknown:
            message = f"`{unknown[0]}` is not a client of `{name}` in this program"
        else:
            message = objection(actuator, verdict, expected, interpreter)
        if message is None:
            self._counts["idled"] += not same_decision(verdict, expected)
            return
        yield self._difference(
            recorded,
            message,
            actuator=name,
            recorded=Decision(name, verdict.by, verdict.values, verdict.fault),
            expected=expected,
            clients=_client_explanations(verdict, expected, interpreter, self._clients[name]),
        )

    def _has_one_winner(self, recorded: Recorded) -> bool:
        """Return True if what was sent is known of every actuator, and follows from the interpreter alone."""
        verdicts = recorded.verdicts
        if len(verdicts) < len(self._actuators) or any(v.violation for v in verdicts.values()):
            return False
        return self._degraded is None or not any(is_excused(v) for v in verdicts.values())

    def _count_breaches(self, t_ns: int, outcome: Outcome) -> None:
        for name in outcome.breaches:
            so_far = self._contracts.get(name)
            self._contracts[name] = ContractCount(
                contract=name,
                frames=so_far.frames + 1 if so_far else 1,
                first_ns=so_far.first_ns if so_far else t_ns,
                last_ns=t_ns,
            )

    def _difference(
        self,
        frame: Recorded,
        message: str,
        *,
        actuator: str | None = None,
        recorded: Decision | None = None,
        expected: Decision | None = None,
        clients: tuple[ClientExplanation, ...] = (),
    ) -> Difference:
        sensors = (s.name for s in self._program.robot.sensors)
        return Difference(
            index=self._counts["frames"],
            k=frame.tick.k,
            t_ns=frame.frame.t_ns,
            actuator=actuator,
            message=message,
            recorded=recorded,
            expected=expected,
            clients=clients,
            missing=tuple(name for name in sensors if frame.frame.readings.get(name) is None),
        )


def _client_explanations(
    verdict: SentCommand, expected: Decision, interpreter: Interpreter, clients: tuple[str, ...]
) -> tuple[ClientExplanation, ...]:
    """Return all clients in the recorded order, or in the order of declaration if some have no fate."""
    fates = dict(verdict.fates)
    order = dict.fromkeys((*fates, *clients)) if len(fates) < len(clients) else fates
    known = frozenset(clients)
    return tuple(
        ClientExplanation(
            client=client,
            fate=fates.get(client),
            part="wins"
            if client == expected.by
            else _role(client, interpreter)
            if client in known
            else "inactive",
        )
        for client in order
    )


def _role(client: str, interpreter: Interpreter) -> Role:
    if interpreter.is_active(client):
        return "active"
    return "silent" if interpreter.is_silent(client) else "inactive"
