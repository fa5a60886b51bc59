"""Questions about a moment, and their answers.

follower = Follower(program)
for recorded in frames:
    follower.take(recorded)
answer = explain(follower.moment, WhyNot("avoid"))
"""

from __future__ import annotations

from dataclasses import dataclass

from colony.ir.frame import Decision
from colony.ir.program import Program
from colony.verify.explain.command import Cut, cuts
from colony.verify.explain.formula import Changes, Formula, changes
from colony.verify.explain.history import Since, Status
from colony.verify.explain.moment import Moment
from colony.verify.explain.network import Network


@dataclass(frozen=True, slots=True)
class Why:
    """The question why a module or wire is active, or an actuator is commanded as it is."""

    subject: str


@dataclass(frozen=True, slots=True)
class WhyNot:
    """The question why a module does not command its actuator, or why a module, wire or actuator is idle."""

    subject: str


Question = Why | WhyNot


@dataclass(frozen=True, slots=True, kw_only=True)
class Sent:
    """What an actuator was sent: the runtime's verdict, or the decision of the interpreter.

    `outside` is the connection that commanded instead of the network, `hold` a stop or lock. `cuts` are the
    fields of the winner's command that a limit or the range changed.
    """

    decision: Decision
    outside: str | None = None
    hold: str | None = None
    cuts: tuple[Cut, ...] = ()
    late: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """An answer.

    Attributes:
        question: The question.
        k: Number of the frame.
        t_ns: Its time.
        claim: What `formula` says, as a sentence without its verb's negation: `avoid is active`.
        holds: True if the claim holds.
        formula: The conditions of the claim.
        changes: Sets of conditions that had to change for the opposite; empty if no change would do.
        is_certain: False if the claim could not be evaluated with the conditions changed, because a value was
            missing: then these had to change, and others perhaps too.
        module: The module that the question is about, or the winner, with its status and since when.
        sent: What the actuator was sent, if the question is about one.
    """

    question: Question
    k: int
    t_ns: int
    claim: str
    holds: bool
    formula: Formula
    changes: Changes
    is_certain: bool
    module: tuple[str, Since] | None = None
    sent: Sent | None = None


def subjects(program: Program) -> tuple[str, ...]:
    """Return the names that questions may be about: actuators, modules and wires."""
    actuators = [a.name for a in program.robot.actuators]
    wires = [w.name for w in program.wires if w.actuator is None]
    return tuple(dict.fromkeys((*actuators, *(m.name for m in program.modules), *wires)))


def explain(moment: Moment, question: Question) -> Explanation:
    """Return the answer to a question about a moment.

    Raises:
        KeyError: the program has no such actuator, module or wire.
    """
    name, network = question.subject, Network(moment)
    actuators = {a.name for a in moment.program.robot.actuators}
    module = next((m for m in moment.program.modules if m.name == name), None)
    if name in actuators:
        winner = moment.winner(name)
        if isinstance(question, Why) and winner is not None:
            return _answer(moment, question, f"{name} is by {winner}", network.is_by(name, winner), name)
        return _answer(moment, question, f"{name} is commanded", network.is_commanded(name), name)
    if module is not None and isinstance(question, WhyNot) and module.actuator is not None:
        formula = network.is_by(module.actuator, name)
        return _answer(moment, question, f"{module.actuator} is by {name}", formula, module.actuator)
    return _answer(
        moment, question, f"{name} is active", network.active(name), module.actuator if module else None
    )


def _answer(
    moment: Moment, question: Question, claim: str, formula: Formula, actuator: str | None
) -> Explanation:
    sent = None if actuator is None else sent_to(moment, actuator)
    names = {m.name for m in moment.program.modules}
    module = question.subject if question.subject in names else sent.decision.by if sent else None
    since = moment.history.modules.get(module) if module is not None else None
    return Explanation(
        question=question,
        k=moment.k,
        t_ns=moment.t_ns,
        claim=claim,
        holds=formula.holds,
        formula=formula,
        changes=changes(formula),
        is_certain=not (moment.silent or moment.blind),
        module=None if module is None or since is None else (module, since),
        sent=sent,
    )


def sent_to(moment: Moment, actuator: str) -> Sent:
    """Return what an actuator was sent in a moment."""
    verdict = moment.verdicts.get(actuator)
    decision = Decision(actuator, moment.winner(actuator), moment.sent(actuator), moment.fault(actuator))
    if verdict is None:
        return Sent(decision=decision, cuts=cuts(moment, actuator))
    return Sent(
        decision=decision,
        outside=verdict.outside,
        hold=verdict.hold,
        cuts=cuts(moment, actuator),
        late=tuple((client, fate) for client, fate in verdict.fates if fate in ("late", "lost", "refused")),
    )


def statuses(moment: Moment) -> dict[str, Status]:
    """Return the status of every module in a moment."""
    return {name: since.value for name, since in moment.history.modules.items()}  # type: ignore[misc]
