"""Explanations as lines of text, and the sentences of causes and of changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, assert_never

from colony.text.wording import duration_text, listed, rounded_ns, time_text
from colony.verify.explain.answer import Explanation, Whether
from colony.verify.explain.causes import (
    Answered,
    Cause,
    Comparison,
    ConstantCondition,
    Heard,
    Past,
    Present,
    Remembered,
    Sendable,
    SimpleCondition,
    TimeConstant,
    Undisturbed,
    UnknownCondition,
    Unwired,
)
from colony.verify.explain.formula import ConditionChange, Formula, Group, Leaf, deciding_parts
from colony.verify.explain.network import Cut

# --- causes text ---------------------------------------------------------------------------------------
#
# Conditions as sentences, with the values that decided them.


class ExplainedTime(NamedTuple):
    """The time of an explained frame, and that from which times in texts count."""

    t_ns: int
    begin_ns: int = 0

    def text(self, at_ns: int) -> str:
        """Return a time."""
        return time_text(at_ns - self.begin_ns)

    def ago(self, at_ns: int) -> str:
        """Return `10.2 s, 1.5 s before`, the time of what led to the frame."""
        before = f", {duration_text(rounded_ns(self.t_ns - at_ns))} before"
        return f"{self.text(at_ns)}{'' if at_ns == self.t_ns else before}"


def cause_text(cause: Cause, holds: bool, now: ExplainedTime) -> str:
    """Return a condition of a frame as a sentence, with the values that decided it."""
    match cause:
        case Comparison(condition=condition, left=left, right=right, gap=gap):
            by = "" if gap is None or gap.startswith("0 ") or gap == "0" else f" by {gap}"
            is_said = left == right and left[:1].isalpha() and left in condition.split()
            sides = "" if is_said else f": {left} against {right}"
            return f"`{condition}` {_verdict(holds)}{by}{sides}{detail_text(cause.detail)}"
        case SimpleCondition(condition=condition, detail=detail):
            return f"`{condition}` is {truth_text(holds)}{detail_text(detail)}"
        case ConstantCondition(condition=condition):
            return f"`{condition}` is always {truth_text(holds)}"
        case Remembered(condition=condition, value=value, since_ns=since_ns):
            since = "" if since_ns is None else f", set at {now.ago(since_ns)}"
            return f"`{condition}` remembers {value}{since}"
        case Past():
            return _past_text(cause, holds, now)
        case Present():
            return _present_text(cause, now)
        case UnknownCondition(condition=condition, missing=missing):
            what = f"{listed(missing)} {'are' if len(missing) > 1 else 'is'}" if missing else "something is"
            return f"`{condition}` is unknown: {what} missing"
        case _:
            return _runtime_text(cause, holds, now)


def _runtime_text(
    cause: TimeConstant | Answered | Heard | Undisturbed | Sendable | Unwired, holds: bool, now: ExplainedTime
) -> str:
    match cause:
        case TimeConstant(dominant=dominant, window_ns=window_ns, at_ns=at_ns):
            window = duration_text(window_ns)
            if at_ns is None:
                return f"{dominant} has not been active, so its time constant of {window} does not count"
            counts = "still counts" if holds else "is over"
            return f"{dominant} was last active at {now.ago(at_ns)}; its time constant of {window} {counts}"
        case Answered(module=module, error=error, blind=blind):
            if error:
                return f"the module in Python {module} failed in this frame"
            if blind:
                return f"the module in Python {module} has no answer{', and is failsafe' if holds else ''}"
            return (
                f"the module in Python {module} answered {'with a command' if holds else 'with no command'}"
            )
        case Heard(module=module, fate=fate):
            if fate is None:
                return f"the client of {module} was in time"
            return f"the client of {module} was {fate}{_FATES.get(fate, '')}"
        case Undisturbed(actuator=actuator, outside=outside, hold=hold):
            return _disturbance_text(actuator, outside, hold)
        case Sendable(actuator=actuator, module=module, fault=fault):
            if fault is None:
                return f"the command of {module} could be sent to {actuator}"
            return f"the command of {module} could not be sent to {actuator}: {FAULTS.get(fault, fault)}"
        case Unwired(actuator=actuator, module=module_or_none):
            what = "no module is wired" if module_or_none is None else f"no wire leads from {module_or_none}"
            return f"{what} to {actuator}"
        case _:
            assert_never(cause)


FAULTS = {
    "missing": "it is failsafe and has no answer, so the idle command was sent",
    "not finite": "a field was not a finite number, so the idle command was sent",
    "bound missing": "the bound of a limit was missing, and there is no idle command",
    "limits contradict": "a lower limit was above an upper one, so the idle command was sent",
}
"""Sentences about faults of commands."""

_FATES = {
    "late": ": its request had not come when the frame was decided",
    "lost": ": its process did not answer",
    "refused": ": its request was malformed",
}


def _disturbance_text(actuator: str, outside: str | None, hold: str | None) -> str:
    match hold:
        case "stopped":
            reason = "the emergency stop was on"
        case "locked":
            reason = "a connection held the lock"
        case _:
            reason = ""
    if outside is not None:
        also = f", and {reason}" if reason else ""
        return f"the connection {outside} commanded {actuator} from outside the network{also}"
    return reason or f"nobody outside the network commanded {actuator}"


def _past_text(past: Past, holds: bool, now: ExplainedTime) -> str:
    duration = duration_text(past.duration_ns)
    elapsed = "" if past.elapsed_ns is None else duration_text(past.elapsed_ns)
    match past.function, past.at_ns:
        case "recently", None:
            return f"`{past.condition}` has not been true before"
        case "recently", int(at_ns):
            relation = "within" if holds else "longer ago than"
            return f"`{past.condition}` was last true at {now.ago(at_ns)}: {relation} {duration}"
        case "sustained", None:
            return f"`{past.condition}` must have been true for {duration}"
        case "sustained", int(at_ns):
            relation = "long enough" if holds else f"{elapsed} of {duration}"
            return f"`{past.condition}` is true since {now.text(at_ns)}: {relation}"
        case _:
            raise AssertionError(past.function)


def _present_text(present: Present, now: ExplainedTime) -> str:
    if present.why is None:
        return f"{present.sensor} has a reading"
    since = (
        "it has had none so far" if present.since_ns is None else f"missing since {now.ago(present.since_ns)}"
    )
    match present.why:
        case "server down":
            why = f"the server {present.server} was down"
        case "too old":
            age = "" if present.within_ns is None else f" than {duration_text(present.within_ns)}"
            why = f"its reading was older{age}"
        case "from the future":
            why = "its reading was taken after the frame"
        case "faulty":
            why = "its reading was not of its type"
        case "no reading":
            within = "" if present.within_ns is None else f" within {duration_text(present.within_ns)}"
            why = f"{present.server} gave no value{within}"
        case _:
            assert_never(present.why)
    return f"{present.sensor} is missing: {why}; {since}"


def _verdict(holds: bool) -> str:
    return "holds" if holds else "fails"


def truth_text(holds: bool) -> str:
    """Return the word for a value."""
    return "true" if holds else "false"


def detail_text(detail: tuple[str, ...]) -> str:
    """Return the values of inputs, in parentheses; nothing if there are none."""
    return f" ({'; '.join(detail)})" if detail else ""


# --- changes text --------------------------------------------------------------------------------------
#
# The conditions that had to change, as clauses: what would have to be so.


MAX_PARTS = 24
"""Maximum number of conditions side by side that an answer shows."""


def changes_texts(change: ConditionChange) -> tuple[str, ...]:
    """Return what would have to be so together, clause by clause, the first of many."""
    texts = [change_text(leaf) for leaf in change.leaves[:MAX_PARTS]]
    omitted = len(change.leaves) - MAX_PARTS
    return (*texts, *([f"{omitted} more"] if omitted > 0 else []))


def change_text(leaf: Leaf) -> str:
    """Return the opposite of a condition as a clause: what would have to be so."""
    holds, cause = leaf.holds, leaf.cause
    match cause:
        case (
            Comparison(condition=condition)
            | SimpleCondition(condition=condition)
            | ConstantCondition(condition=condition)
        ):
            return f"`{condition}` {'did not hold' if holds else 'held'}"
        case Remembered(condition=condition) | UnknownCondition(condition=condition):
            return f"`{condition}` {'did not hold' if holds else 'held'}"
        case Past(function="recently", condition=condition, duration_ns=duration_ns):
            had = "had not been" if holds else "had been"
            return f"`{condition}` {had} true in the {duration_text(duration_ns)} before"
        case Past(condition=condition, duration_ns=duration_ns):
            had = "had not been" if holds else "had been"
            return f"`{condition}` {had} true for {duration_text(duration_ns)}"
        case _:
            return _change_of_runtime(cause, holds)


def _change_of_runtime(
    cause: Present | TimeConstant | Answered | Heard | Undisturbed | Sendable | Unwired, holds: bool
) -> str:
    match cause:
        case Present(sensor=sensor):
            return f"{sensor} {'were missing' if holds else 'had a reading'}"
        case TimeConstant(dominant=dominant, window_ns=window_ns):
            had = "had not been" if holds else "had been"
            return f"{dominant} {had} active in the {duration_text(window_ns)} before"
        case Answered(module=module):
            return f"{module} answered {'with no command' if holds else 'with a command'}"
        case Heard(module=module):
            return f"the request of {module} had come in time"
        case Undisturbed(actuator=actuator):
            return f"{actuator} had been left to the network"
        case Sendable(module=module):
            return f"the command of {module} could have been sent"
        case Unwired(actuator=actuator):
            return f"{actuator} were wired otherwise"
        case _:
            assert_never(cause)


# --- text ----------------------------------------------------------------------------------------------


MAX_DEPTH = 10
"""Maximum depth of the lines of an answer."""

MAX_LEVEL = 100
"""Maximum depth of the conditions below each other that are followed, with or without a line."""


def lines(explanation: Explanation, begin_ns: int = 0) -> tuple[str, ...]:
    """Return an answer as lines of text: the claim, the conditions indented below it, what had to change.

    Times count from `begin_ns`.
    """
    formula, now = explanation.formula, ExplainedTime(explanation.t_ns, begin_ns)
    head, parts = _joined(formula)
    answer = explanation.answer
    is_joined = head is not None and head.startswith(answer)
    first, below = (head, parts) if is_joined else (answer, (formula,))
    return (
        f"{now.text(now.t_ns)}: {first}{_sent_text(explanation)}",
        *(f"  {line}" for line in _since_lines(explanation, now)),
        *(f"  {_cut_text(cut)}" for cut in _cuts(explanation)),
        *(f"  {line}" for part in below for line in _tree(part, now, 0)),
        *(f"  {line}" for line in _changes_lines(explanation)),
    )


MAX_CLAUSES = 2
"""Maximum number of clauses that had to change together which share a line."""

MAX_CAUSES = 4
"""Maximum number of conditions that a short answer has."""


def short(explanation: Explanation) -> str:
    """Return the first conditions that decided and the last, which is the conclusion of an implication."""
    texts = list(dict.fromkeys(_short(explanation.formula, ExplainedTime(explanation.t_ns))))
    if len(texts) > MAX_CAUSES:
        texts[MAX_CAUSES - 1 : -1] = [f"{len(texts) - MAX_CAUSES} more"]
    return "; ".join(texts)


def _short(formula: Formula, now: ExplainedTime, level: int = 0) -> Iterator[str]:
    """Yield the conditions that decided; of modules, wires and winners no more than that they are active."""
    if level >= MAX_LEVEL:
        return
    if isinstance(formula, Leaf):
        if not formula.implied:
            yield cause_text(formula.cause, formula.holds, now)
        return
    match formula.subject:
        case "module" | "wire":
            yield f"{formula.name} is {'' if formula.holds else 'not '}active"
        case "winner":
            subject, _, predicate = formula.name.partition(" is ")
            yield f"{subject} is {'' if formula.holds else 'not '}{predicate}"
            for part in shown_parts(formula):
                if isinstance(part, Leaf):
                    yield from _short(part, now, level + 1)
        case _:
            for part in shown_parts(formula):
                yield from _short(part, now, level + 1)


def _sent_text(explanation: Explanation) -> str:
    """Return who commands the actuator, where the answer does not say so."""
    sent, question = explanation.sent, explanation.question
    if sent is None or (not isinstance(question, Whether) and question.subject == sent.decision.actuator):
        return ""
    actuator, by = sent.decision.actuator, sent.decision.by
    if by is None:
        return f"; {actuator} is idle" if sent.outside is None else f"; {actuator} is by {sent.outside}"
    return "" if explanation.answer == f"{actuator} is by {by}" else f"; {actuator} is by {by}"


def _since_lines(explanation: Explanation, now: ExplainedTime) -> Iterator[str]:
    """Yield since when the module is as it is, if the run shows it."""
    if explanation.module is not None:
        name, since = explanation.module
        if not since.first and since.t_ns < explanation.t_ns:
            yield f"{name} is {since.value} since {now.ago(since.t_ns)}"


# --- the tree of conditions ------------------------------------------------------------------------


def _tree(formula: Formula, now: ExplainedTime, depth: int, level: int = 0) -> Iterator[str]:
    """Yield a line for each condition that decided, indented by depth."""
    indent = "  " * depth
    if isinstance(formula, Leaf):
        if not formula.implied:
            yield indent + cause_text(formula.cause, formula.holds, now)
        return
    head, parts = _joined(formula)
    if depth >= MAX_DEPTH or level >= MAX_LEVEL:
        yield f"{indent}{head or 'and so on'}"
        return
    if head is not None:
        yield indent + head
        depth += 1
    for part in parts[:MAX_PARTS]:
        yield from _tree(part, now, depth, level + 1)
    if len(parts) > MAX_PARTS:
        yield f"{'  ' * depth}and {len(parts) - MAX_PARTS} more"


def _joined(formula: Formula) -> tuple[str | None, tuple[Formula, ...]]:
    """Return the line of a group, with that of its only part if both can be one line, and what is below."""
    if isinstance(formula, Leaf):
        return None, (formula,)
    parts = shown_parts(formula)
    head = head_text(formula)
    if head is not None and len(parts) == 1:
        [part] = parts
        if isinstance(part, Group) and part.subject == "predicate":
            below = shown_parts(part)
            if (
                len(below) == 1
                and isinstance(below[0], Leaf)
                and isinstance(below[0].cause, ConstantCondition)
            ):
                return f"{head}: its predicate is always {truth_text(part.holds)}", ()
            return f"{head}: {head_text(part)}", below
    return head, parts


def shown_parts(group: Group) -> tuple[Formula, ...]:
    """Return the parts that decide the value of a group, without those that go without saying."""
    return tuple(p for p in deciding_parts(group) if not (isinstance(p, Leaf) and p.implied))


def head_text(group: Group) -> str | None:
    """Return what a group says of its subject, None for a mere part of a condition."""
    name, holds = group.name, group.holds
    match group.subject:
        case None:
            return None
        case "module" | "wire":
            return f"{name} is {'' if holds else 'not '}active"
        case "predicate":
            return f"its predicate is {truth_text(holds)}"
        case "let" | "condition" | "memory":
            return f"`{name}` is {truth_text(holds)}"
        case "winner" | "dominated":
            return None  # the modules below say it
        case _:
            assert_never(group.subject)


# --- the command, and what had to change -----------------------------------------------------------


def _cuts(explanation: Explanation) -> tuple[Cut, ...]:
    return () if explanation.sent is None else explanation.sent.cuts


def _cut_text(cut: Cut) -> str:
    by = "the range of the actuator" if cut.limit is None else f"the limit `{cut.limit}`"
    missing = "; the bound is missing, so the idle command's value stands in" if cut.is_missing else ""
    return f"{cut.field}: {cut.wanted} was cut to {cut.sent} by {by}{detail_text(cut.detail)}{missing}"


def _changes_lines(explanation: Explanation) -> Iterator[str]:
    changes = explanation.changes
    if not changes:
        yield "nothing that was sensed or remembered would have changed this"
    for is_certain, word in ((True, "would"), (False, "might")):
        ways = [*dict.fromkeys(changes_texts(c) for c in changes if c.is_certain == is_certain)]
        only = " only" if is_certain and any(len(way) > 1 for way in ways) else ""
        if len(ways) == 1 and len(ways[0]) <= MAX_CLAUSES:
            yield f"it {word} change{only} if {listed(ways[0])}"
        elif ways:
            yield f"it {word} change{only}"
            yield from (
                f"  {line}" for i, way in enumerate(ways) for line in _way_lines(way, is_first=i == 0)
            )


def _way_lines(way: Sequence[str], *, is_first: bool) -> Iterator[str]:
    """Yield what would have to be so together, a line each."""
    first, *others = way
    yield f"{'if' if is_first else 'or if'} {first}"
    for other in others:
        yield f"  and {other}"
