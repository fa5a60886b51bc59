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
from collections.abc import Callable, Iterable, Iterator

from colony.analysis.follower import Follower, Interpreters, UnknownMemory, step_given
from colony.analysis.report import (
    AuditReport,
    ClientExplanation,
    ContractCount,
    Difference,
    Role,
    is_excused,
    objection,
    outside_objection,
    same_decision,
)
from colony.ir.frame import ActuatorOutcome, Decision, Outcome, is_connection
from colony.ir.program import Program, assumptions
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.recordings.recorded import RecordingReader
from colony.verify.reference.interpreter import Interpreter


def audit_recording(
    program: Program, recording: RecordingReader, progress: Callable[[], None] = lambda: None
) -> AuditReport:
    """Compare a recording with the reference interpreter; `progress` is called after each frame.

    Raises:
        DiagnosticError: the recording is of another program.
    """
    auditor = Auditor(program)
    for frame in recording.frames(program):
        auditor.take(frame)
        progress()
    auditor.end(damaged=recording.damaged)
    return auditor.report()


def audit(program: Program, frames: Iterable[RunFrame]) -> AuditReport:
    """Compare a run with the reference interpreter; `frames` must begin with the first one."""
    auditor = Auditor(program)
    for frame in frames:
        auditor.take(frame)
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
        interpreters = Interpreters(program)
        self._follower = Follower(interpreters)
        degrades = any(a.on_loss == "degrade" for a in program.robot.actuators)
        # no keyframe has the memory without the lost clients
        self._degraded = Follower(interpreters, trusts_degraded=False) if degrades else None
        self._previous: RunFrame | None = None
        self._first_ns = 0
        self._counts: Counter[str] = Counter()
        self._unheard_by_server: Counter[str] = Counter()
        self._contracts: dict[str, ContractCount] = {}
        self._assumed = {a.name for a in assumptions(program)}
        self._first: Difference | None = None

    def take(self, frame: RunFrame) -> None:
        """Compare one frame, and count it."""
        if self._previous is None:
            self._first_ns = frame.frame.t_ns
        interpreter = self._follower.feed(frame)
        degraded = None if self._degraded is None else self._degraded.feed(frame)
        differences = [*self._sequence_faults(frame)]
        if not isinstance(interpreter, UnknownMemory):
            differences += self._decisions(frame, interpreter, degraded)
        else:
            self._counts["forgotten" if interpreter.reason == "forgotten" else "unknown"] += 1
        self._first = self._first or next(iter(differences), None)
        fates = {fate for v in frame.verdicts.values() for _, fate in v.fates}
        self._counts.update(fates & {"late", "lost", "refused"})
        self._counts["violations"] += any(v.violation for v in frame.verdicts.values())
        self._counts["outside"] += any(v.outside is not None for v in frame.verdicts.values())
        self._counts["holds"] += any(v.hold is not None for v in frame.verdicts.values())
        self._counts["restarts"] += frame.begins_epoch and self._previous is not None
        self._counts["resumed"] += self._follower.has_resumed
        self._counts["differing"] += bool(differences)
        self._counts["frames"] += 1
        self._previous = frame

    def end(self, *, damaged: bool) -> None:
        """If `damaged`, record that the recording is damaged after its last frame."""
        self._follower.end(damaged=damaged)

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
            damaged=tuple(self._follower.damaged),
            unheard_by_server=dict(self._unheard_by_server),
        )

    def _sequence_faults(self, frame: RunFrame) -> Iterator[Difference]:
        """Yield faults in the sequence of frames: memory needs every frame since the epoch began."""
        tick, previous = frame.tick, self._previous
        if previous is None:
            return
        gap = tick.k - previous.tick.k - 1
        is_expected = gap >= frame.skipped > 0 or tick.previous == previous.tick.k
        if gap < 0 or not (is_expected or frame.begins_epoch or frame.damaged):
            missing = f": {gap} between them are not in the recording" if gap > 0 else ""
            message = f"frame {tick.k} follows frame {previous.tick.k}{missing}"
            yield self._difference(frame, message)
        is_excused_start = frame.begins_epoch or frame.memory_unknown or frame.damaged
        if tick.start != previous.tick.start and not is_excused_start:
            yield self._difference(frame, f"a new epoch began with frame {tick.start}, which is missing")
        if frame.frame.t_ns <= previous.frame.t_ns:
            message = f"time must increase: {frame.frame.t_ns} ns follows {previous.frame.t_ns} ns"
            yield self._difference(frame, message)

    def _decisions(
        self, frame: RunFrame, interpreter: Interpreter, degraded: Interpreter | UnknownMemory | None
    ) -> Iterator[Difference]:
        """Decide the frame, and yield the differences of verdicts and broken contracts.

        `degraded` is the interpreter in which lost clients do not act, None if no actuator degrades.
        """
        outcome = step_given(interpreter, frame)
        expected = {d.actuator: (d, interpreter) for d in outcome.decisions}
        if isinstance(degraded, Interpreter):
            lost = frozenset(address.partition("/")[2] for address in frame.tick.lost)
            decisions = degraded.step(frame.frame, lost, frame.answers).decisions
            expected |= {d.actuator: (d, degraded) for d in decisions if self._degrades(d.actuator)}
        for name, (decision, decider) in expected.items():
            if isinstance(degraded, UnknownMemory) and self._degrades(name):
                self._counts["undecided"] += 1
                continue
            yield from self._compare(frame, name, decision, decider, interpreter)
        self._count_breaches(frame.frame.t_ns, outcome)
        if (
            frame.breaches is not None
            and frame.breaches != outcome.breaches
            and self._has_one_winner(frame, degraded)
        ):
            found, correct = (", ".join(names) or "none" for names in (frame.breaches, outcome.breaches))
            message = f"broken contracts: recorded {found}; in the interpreter {correct}"
            yield self._difference(frame, message)

    def _degrades(self, actuator: str) -> bool:
        return self._actuators[actuator].on_loss == "degrade"

    def _compare(
        self,
        frame: RunFrame,
        name: str,
        expected: Decision,
        decider: Interpreter,
        interpreter: Interpreter,
    ) -> Iterator[Difference]:
        """Yield the difference of a verdict from the decision that `decider` expects."""
        verdict, actuator = frame.verdicts.get(name), self._actuators[name]
        if verdict is None:
            self._counts["unheard"] += 1
            self._unheard_by_server[actuator.server] += 1
            return
        sent = Decision(name, verdict.by, verdict.values, verdict.fault)
        if verdict.outside is not None or verdict.hold is not None:
            message = outside_objection(actuator, verdict, interpreter)
            if message is not None:
                yield self._difference(frame, message, actuator=name, recorded=sent)
            return
        self._counts["compared"] += 1
        clients = self._clients[name]
        unknown = [c for c, _ in verdict.fates if c not in clients and not is_connection(c)]
        if unknown:
            message = f"`{unknown[0]}` is not a client of `{name}` in this program"
        else:
            message = objection(actuator, verdict, expected, decider)
        if message is None:
            self._counts["idled"] += not same_decision(verdict, expected)
            return
        yield self._difference(
            frame,
            message,
            actuator=name,
            recorded=sent,
            expected=expected,
            clients=_client_explanations(verdict, expected, decider, self._clients[name]),
        )

    def _has_one_winner(self, frame: RunFrame, degraded: Interpreter | UnknownMemory | None) -> bool:
        """Return True if what was sent is known of every actuator, and follows from the interpreter alone."""
        verdicts = frame.verdicts
        if len(verdicts) < len(self._actuators) or any(v.violation for v in verdicts.values()):
            return False
        return not isinstance(degraded, Interpreter) or not any(is_excused(v) for v in verdicts.values())

    def _count_breaches(self, t_ns: int, outcome: Outcome) -> None:
        for name in outcome.breaches:
            so_far = self._contracts.get(name)
            self._contracts[name] = ContractCount(
                contract=name,
                frames=so_far.frames + 1 if so_far else 1,
                first_ns=so_far.first_ns if so_far else t_ns,
                last_ns=t_ns,
                assumed=name in self._assumed,
            )

    def _difference(
        self,
        frame: RunFrame,
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
    verdict: ActuatorOutcome, expected: Decision, interpreter: Interpreter, clients: tuple[str, ...]
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
