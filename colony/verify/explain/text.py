"""Explanations as lines of text: the only place that makes sentences of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from colony.text.wording import duration_text, listed
from colony.verify.explain.answer import Explanation, Whether
from colony.verify.explain.causes import (
    Answered,
    Cause,
    Comparison,
    Constant,
    Heard,
    Past,
    Present,
    Reading,
    Remembered,
    Sendable,
    TimeConstant,
    Undisturbed,
    Unknown,
    Unwired,
)
from colony.verify.explain.command import Cut
from colony.verify.explain.formula import Change, Formula, Group, Leaf, deciding_parts

MAX_DEPTH = 10
MAX_LEVEL = 100
"""Maximum depth of the tree of conditions that an answer shows, and of its nesting without lines."""

MAX_PARTS = 24
"""Maximum number of conditions side by side that an answer shows."""


def lines(explanation: Explanation) -> tuple[str, ...]:
    """Return an answer as lines of text: the claim, the conditions indented below it, what had to change."""
    formula, t_ns = explanation.formula, explanation.t_ns
    head, parts = _joined(formula)
    answer = explanation.answer
    is_joined = head is not None and head.startswith(answer)
    first, below = (head, parts) if is_joined else (answer, (formula,))
    return (
        f"{time_text(t_ns)}: {first}{_sent_text(explanation)}",
        *(f"  {line}" for line in _since_lines(explanation)),
        *(f"  {_cut_text(cut)}" for cut in _cuts(explanation)),
        *(f"  {line}" for part in below for line in _tree(part, t_ns, 0)),
        *(f"  {line}" for line in _changes_lines(explanation)),
    )


MAX_CAUSES = 4
"""Maximum number of conditions that a short answer has."""


def short(explanation: Explanation) -> str:
    """Return the first conditions that decided, on one line."""
    texts = list(dict.fromkeys(_short(explanation.formula, explanation.t_ns)))
    more = [f"and {len(texts) - MAX_CAUSES} more"] if len(texts) > MAX_CAUSES else []
    return "; ".join((*texts[:MAX_CAUSES], *more))


def _short(formula: Formula, t_ns: int, level: int = 0) -> Iterator[str]:
    """Yield the conditions that decided; of modules, wires and winners no more than that they are active."""
    if level >= MAX_LEVEL:
        return
    if isinstance(formula, Leaf):
        if not formula.implied:
            yield cause_text(formula.cause, formula.holds, t_ns)
        return
    match formula.subject:
        case "module" | "wire":
            yield f"{formula.name} is {'' if formula.holds else 'not '}active"
        case "winner":
            subject, _, predicate = formula.name.partition(" is ")
            yield f"{subject} is {'' if formula.holds else 'not '}{predicate}"
            for part in shown_parts(formula):
                if isinstance(part, Leaf):
                    yield from _short(part, t_ns, level + 1)
        case _:
            for part in shown_parts(formula):
                yield from _short(part, t_ns, level + 1)


def time_text(t_ns: int) -> str:
    """Return the time of a frame in seconds."""
    return f"{t_ns / 1e9:.10g} s"


def _sent_text(explanation: Explanation) -> str:
    """Return who commands the actuator, where the answer does not say so."""
    sent, question = explanation.sent, explanation.question
    if sent is None or (not isinstance(question, Whether) and question.subject == sent.decision.actuator):
        return ""
    actuator, by = sent.decision.actuator, sent.decision.by
    if by is None:
        return f"; {actuator} is idle" if sent.outside is None else f"; {actuator} is by {sent.outside}"
    return "" if explanation.answer == f"{actuator} is by {by}" else f"; {actuator} is by {by}"


def _since_lines(explanation: Explanation) -> Iterator[str]:
    """Yield since when the module is as it is, if the run shows it."""
    if explanation.module is not None:
        name, since = explanation.module
        if not since.first and since.t_ns < explanation.t_ns:
            yield f"{name} is {since.value} since {_ago(since.t_ns, explanation.t_ns)}"


def cause_text(cause: Cause, holds: bool, t_ns: int) -> str:
    """Return a condition as a sentence, with the values that decided it; `t_ns` is the time of the frame."""
    match cause:
        case Comparison(condition=condition, left=left, right=right, gap=gap):
            by = "" if gap is None or gap.startswith("0 ") or gap == "0" else f" by {gap}"
            return f"`{condition}` {_verdict(holds)}{by}: {left} against {right}{_details(cause.detail)}"
        case Reading(condition=condition, detail=detail):
            return f"`{condition}` is {_truth(holds)}{_details(detail)}"
        case Constant(condition=condition):
            return f"`{condition}` is always {_truth(holds)}"
        case Remembered(condition=condition, value=value, since_ns=since_ns):
            since = "" if since_ns is None else f", set at {_ago(since_ns, t_ns)}"
            return f"`{condition}` remembers {value}{since}"
        case Past():
            return _past_text(cause, holds, t_ns)
        case Present():
            return _present_text(cause, t_ns)
        case Unknown(condition=condition, missing=missing):
            what = f"{listed(missing)} {'are' if len(missing) > 1 else 'is'}" if missing else "something is"
            return f"`{condition}` is unknown: {what} missing"
        case _:
            return _runtime_text(cause, holds, t_ns)


def _runtime_text(
    cause: TimeConstant | Answered | Heard | Undisturbed | Sendable | Unwired, holds: bool, t_ns: int
) -> str:
    match cause:
        case TimeConstant(dominant=dominant, window_ns=window_ns, at_ns=at_ns):
            window = duration_text(window_ns)
            if at_ns is None:
                return f"{dominant} has not been active, so its time constant of {window} does not count"
            counts = "still counts" if holds else "is over"
            return (
                f"{dominant} was last active at {_ago(at_ns, t_ns)}; its time constant of {window} {counts}"
            )
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


def _past_text(past: Past, holds: bool, t_ns: int) -> str:
    duration = duration_text(past.duration_ns)
    elapsed = "" if past.elapsed_ns is None else duration_text(past.elapsed_ns)
    match past.function, past.at_ns:
        case "recently", None:
            return f"`{past.condition}` has not been true before"
        case "recently", int(at_ns):
            relation = "within" if holds else "longer ago than"
            return f"`{past.condition}` was last true at {_ago(at_ns, t_ns)}: {relation} {duration}"
        case "sustained", None:
            return f"`{past.condition}` must have been true for {duration}"
        case "sustained", int(at_ns):
            relation = "long enough" if holds else f"{elapsed} of {duration}"
            return f"`{past.condition}` is true since {time_text(at_ns)}: {relation}"
        case _:
            raise AssertionError(past.function)


def _present_text(present: Present, t_ns: int) -> str:
    if present.why is None:
        return f"{present.sensor} has a reading"
    since = (
        "it has had none so far"
        if present.since_ns is None
        else f"missing since {_ago(present.since_ns, t_ns)}"
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


def _ago(at_ns: int, t_ns: int) -> str:
    """Return `10.2 s, 1.5 s before`, the time of what led to a frame."""
    return time_text(at_ns) if at_ns == t_ns else f"{time_text(at_ns)}, {duration_text(t_ns - at_ns)} before"


def _verdict(holds: bool) -> str:
    return "holds" if holds else "fails"


def _truth(holds: bool) -> str:
    return "true" if holds else "false"


def _details(detail: tuple[str, ...]) -> str:
    return f" ({'; '.join(detail)})" if detail else ""


# --- the tree of conditions ------------------------------------------------------------------------


def _tree(formula: Formula, t_ns: int, depth: int, level: int = 0) -> Iterator[str]:
    """Yield a line for each condition that decided, indented by depth."""
    indent = "  " * depth
    if isinstance(formula, Leaf):
        if not formula.implied:
            yield indent + cause_text(formula.cause, formula.holds, t_ns)
        return
    head, parts = _joined(formula)
    if depth >= MAX_DEPTH or level >= MAX_LEVEL:
        yield f"{indent}{head or 'and so on'}"
        return
    if head is not None:
        yield indent + head
        depth += 1
    for part in parts[:MAX_PARTS]:
        yield from _tree(part, t_ns, depth, level + 1)
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
            if len(below) == 1 and isinstance(below[0], Leaf) and isinstance(below[0].cause, Constant):
                return f"{head}: its predicate is always {_truth(part.holds)}", ()
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
            return f"its predicate is {_truth(holds)}"
        case "let" | "condition" | "memory":
            return f"`{name}` is {_truth(holds)}"
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
    return f"{cut.field}: {cut.wanted} was cut to {cut.sent} by {by}{_details(cut.detail)}{missing}"


def _changes_lines(explanation: Explanation) -> Iterator[str]:
    changes = explanation.changes
    if not changes:
        yield "nothing that was sensed or remembered would have changed this"
    for is_certain, word in ((True, "would"), (False, "might")):
        texts = [changes_text(change) for change in changes if change.is_certain == is_certain]
        together = any(len(change.leaves) > 1 for change in changes if change.is_certain == is_certain)
        only = "only " if together and is_certain else ""
        if texts:
            yield f"it {word} change {only}if {'; or if '.join(texts)}"


def changes_text(change: Change) -> str:
    """Return what would have to be so together, the first of many."""
    texts = [change_text(leaf) for leaf in change.leaves[:MAX_PARTS]]
    omitted = len(change.leaves) - MAX_PARTS
    return listed([*texts, *([f"{omitted} more"] if omitted > 0 else [])])


def change_text(leaf: Leaf) -> str:
    """Return the opposite of a condition as a clause: what would have to be so."""
    holds, cause = leaf.holds, leaf.cause
    match cause:
        case Comparison(condition=condition) | Reading(condition=condition) | Constant(condition=condition):
            return f"`{condition}` {'did not hold' if holds else 'held'}"
        case Remembered(condition=condition) | Unknown(condition=condition):
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
