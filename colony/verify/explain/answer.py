"""Questions about a moment, and their answers.

follower = MomentFollower(program)
for recorded in frames:
    follower.take(recorded)
answer = explain(follower.moment, WhyNot("avoid"))
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from colony.ir.expression import Expression
from colony.ir.frame import Decision, Frame
from colony.ir.program import Example, Program
from colony.verify.explain.formula import Changes, Formula, changes
from colony.verify.explain.moment import Historian, Moment, Since, moment_of
from colony.verify.explain.network import Cut, NetworkExplainer, cuts
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot
from colony.verify.testing.examples import ExampleFailure
from colony.verify.testing.frames import snapshots_of

# --- answer --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Why:
    """The question why a module or wire is active, an actuator has its command, or a sensor is present."""

    subject: str


@dataclass(frozen=True, slots=True)
class WhyNot:
    """The question why a module does not command its actuator, or why another name is idle or missing."""

    subject: str


@dataclass(frozen=True, slots=True)
class Whether:
    """The question why a contract or an expectation is true or false; `condition` is its name or its text."""

    condition: str


Question = Why | WhyNot | Whether


@dataclass(frozen=True, slots=True, kw_only=True)
class SentOutcome:
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
        claim: What `formula` says: `drive is by avoid`.
        holds: True if the claim holds.
        answer: The claim, or its opposite, whichever holds: `drive is not by avoid`.
        formula: The conditions of the claim.
        changes: Sets of conditions that had to change for the opposite; empty if no change would do.
        module: The module that the question is about, or the winner, with its status and since when.
        sent: What the actuator was sent, if the question is about one.
    """

    question: Question
    k: int
    t_ns: int
    claim: str
    holds: bool
    answer: str
    formula: Formula
    changes: Changes
    module: tuple[str, Since] | None = None
    sent: SentOutcome | None = None


def subjects(program: Program) -> tuple[str, ...]:
    """Return the names that questions may be about: actuators, modules, wires and sensors."""
    actuators = [a.name for a in program.robot.actuators]
    wires = [w.name for w in program.wires if w.actuator is None]
    sensors = [s.name for s in program.robot.sensors if s.sent is None]
    return tuple(dict.fromkeys((*actuators, *(m.name for m in program.modules), *wires, *sensors)))


def explain(moment: Moment, question: Why | WhyNot) -> Explanation:
    """Return the answer to a question about a moment.

    Raises:
        KeyError: the program has no such actuator, module, wire or sensor.
    """
    name, network = question.subject, NetworkExplainer(moment)
    program = moment.program
    module = next((m for m in program.modules if m.name == name), None)
    if any(a.name == name for a in program.robot.actuators):
        return _about_actuator(network, question)
    if any(s.name == name for s in program.robot.sensors):
        claim = _Claim(f"{name} is present", f"{name} is missing")
        return _answer(network, question, claim, network.conditions.present(name), None)
    actuator = None if module is None else module.actuator
    if actuator is not None and isinstance(question, WhyNot):
        return _answer(
            network, question, _is(actuator, f"by {name}"), network.is_by(actuator, name), actuator
        )
    return _answer(network, question, _is(name, "active"), network.active(name), actuator)


def _about_actuator(network: NetworkExplainer, question: Why | WhyNot) -> Explanation:
    moment, name = network.moment, question.subject
    winner, verdict = moment.winner(name), moment.verdicts.get(name)
    if winner is not None and isinstance(question, Why):
        claim = _Claim(f"{name} is by {winner}", f"{name} is by {winner}, but in the interpreter it is not")
        return _answer(network, question, claim, network.is_by(name, winner), name)
    outside = None if verdict is None else verdict.outside
    idle = f"{name} is idle" if outside is None else f"{name} is by {outside}, from outside the network"
    claim = _Claim(f"{name} is commanded", idle)
    return _answer(network, question, claim, network.is_commanded(name), name)


def explain_condition(moment: Moment, name: str, expression: Expression) -> Explanation:
    """Return why a contract or an expectation, called `name`, is true or false in a moment."""
    network = NetworkExplainer(moment)
    formula = network.conditions.formula(expression)
    return _answer(network, Whether(name), _is(f"`{name}`", "true"), formula, None)


class _Claim(NamedTuple):
    """A claim and its opposite, as sentences."""

    text: str
    opposite: str


def _is(subject: str, predicate: str) -> _Claim:
    return _Claim(f"{subject} is {predicate}", f"{subject} is not {predicate}")


def _answer(
    network: NetworkExplainer, question: Question, claim: _Claim, formula: Formula, actuator: str | None
) -> Explanation:
    moment = network.moment
    sent = None if actuator is None else sent_to(moment, actuator)
    asked = None if isinstance(question, Whether) else question.subject
    module = asked if asked in moment.history.modules else sent.decision.by if sent else None
    since = None if module is None else moment.history.modules.get(module)
    return Explanation(
        question=question,
        k=moment.k,
        t_ns=moment.t_ns,
        claim=claim.text,
        holds=formula.holds,
        answer=claim.text if formula.holds else claim.opposite,
        formula=formula,
        changes=changes(formula, network.conditions.entangled(formula)),
        module=None if module is None or since is None else (module, since),
        sent=sent,
    )


def sent_to(moment: Moment, actuator: str) -> SentOutcome:
    """Return what an actuator was sent in a moment."""
    verdict = moment.verdicts.get(actuator)
    decision = Decision(actuator, moment.winner(actuator), moment.sent(actuator), moment.fault(actuator))
    if verdict is None:
        return SentOutcome(decision=decision, cuts=cuts(moment, actuator))
    return SentOutcome(
        decision=decision,
        outside=verdict.outside,
        hold=verdict.hold,
        cuts=cuts(moment, actuator),
        late=tuple((client, fate) for client, fate in verdict.fates if fate in ("late", "lost", "refused")),
    )


# --- runs ----------------------------------------------------------------------------------------------
#
# Moments of runs that tests and proofs consist of: failing tests, and counterexamples of contracts.


def moments(
    program: Program,
    snapshots: Sequence[Snapshot],
    expectations: Mapping[int, Sequence[Expression]] | None = None,
) -> Iterator[Moment]:
    """Yield the moment of each frame of a run from the program's initial memory.

    `expectations` are conditions that are evaluated in some frames, by their index, in order: what they
    remember is part of the run.

    Raises:
        DiagnosticError: a module in Python cannot be imported or built.
    """
    interpreter, historian = Interpreter(program), Historian(program)
    for k, snapshot in enumerate(snapshots):
        before, earlier = interpreter.state, historian.history
        outcome = interpreter.step_in_base_units(
            snapshot.t_ns, snapshot.readings, snapshot.lost, snapshot.given, restarted=snapshot.restarted
        )
        after = interpreter.state
        assert after is not None, "a frame was decided"
        winners = {d.actuator: d.by for d in outcome.decisions}
        history = historian.take(interpreter, after.memory.functions, winners, first=k == 0)
        yield moment_of(
            program,
            interpreter,
            before,
            history,
            k=k,
            frame=Frame(snapshot.t_ns, snapshot.readings, restarted=snapshot.restarted),
            outcome=outcome,
            absent={},
            earlier=earlier,
            lost=snapshot.lost,
            late=frozenset(a for a, given in snapshot.given.items() if given.values is None),
        )
        for expectation in (expectations or {}).get(k, ()):
            interpreter.value_of(expectation)


def explain_failure(program: Program, example: Example, failure: ExampleFailure) -> Explanation | None:
    """Return why an expectation or a contract was not true when a test failed.

    None if the failure is of another kind: an element of a missing array was set.

    Raises:
        DiagnosticError: a module in Python cannot be imported or built.
    """
    expectations: dict[int, Sequence[Expression]] = {}
    failed: tuple[str, Expression] | None = None
    for step in example.steps:
        for _ in step.times_ns:
            expectations[len(expectations)] = step.expectations
        for expectation in step.expectations:
            if expectation.span == failure.span and failure.t_ns in step.times_ns:
                failed = failure.expected, expectation
    for contract in program.contracts:
        if contract.span == failure.span:
            failed = contract.name, contract.expression
    if failed is None:
        return None
    run = moments(program, snapshots_of(program, example), expectations)
    moment = next(m for m in run if m.t_ns == failure.t_ns)
    return explain_condition(moment, *failed)


def explain_breach(program: Program, contract: str, snapshots: Sequence[Snapshot]) -> Explanation:
    """Return why a contract is not true in the last frame of a run of `program`."""
    *_, last = moments(program, snapshots)
    expression = next(c.expression for c in program.contracts if c.name == contract)
    return explain_condition(last, contract, expression)
