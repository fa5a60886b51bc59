"""Explanations as lines of text: the only place that makes sentences of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from colony.text.wording import duration_text, listed
from colony.verify.explain.answer import Explanation
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
)
from colony.verify.explain.command import Cut
from colony.verify.explain.formula import Formula, Group, Leaf, deciding_parts

MAX_DEPTH = 10
"""Maximum depth of the tree of conditions that an answer shows."""


def lines(explanation: Explanation) -> tuple[str, ...]:
    """Return an answer as lines of text: the claim, the conditions indented below it, what had to change."""
    return (
        f"{time_text(explanation.t_ns)}: {claim_text(explanation)}",
        *(f"  {line}" for line in _sent_lines(explanation)),
        *(f"  {line}" for line in _tree(explanation.formula, explanation.t_ns, 0, explanation.holds)),
        *(f"  {line}" for line in _changes_lines(explanation)),
    )


def time_text(t_ns: int) -> str:
    """Return the time of a frame in seconds."""
    return f"{t_ns / 1e9:.10g} s"


def claim_text(explanation: Explanation) -> str:
    """Return the claim as a sentence that holds: `drive is not by avoid`."""
    if explanation.holds:
        return explanation.claim
    subject, verb, rest = explanation.claim.partition(" is ")
    return f"{subject}{verb}not {rest}"


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
        case Unknown(condition=condition):
            return f"`{condition}` is unknown: it reads something missing"
        case _:
            return _runtime_text(cause, holds, t_ns)


def _runtime_text(
    cause: TimeConstant | Answered | Heard | Undisturbed | Sendable, holds: bool, t_ns: int
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
            if blind:
                return f"the module in Python {module} has no answer, and is failsafe"
            if error:
                return f"the module in Python {module} failed in this frame"
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
            relation = "less" if holds else "not less"
            when = _ago(at_ns, t_ns)
            return f"`{past.condition}` was last true at {when}, which is {relation} than {duration}"
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


def _tree(formula: Formula, t_ns: int, depth: int, holds: bool) -> Iterator[str]:
    """Yield a line for each condition that decided, indented by depth."""
    indent = "  " * depth
    if isinstance(formula, Leaf):
        yield indent + cause_text(formula.cause, formula.holds, t_ns)
        return
    head = head_text(formula)
    if head:
        yield indent + head
        depth += 1
    if depth > MAX_DEPTH:
        yield f"{'  ' * depth}and so on"
        return
    for part in deciding_parts(formula):
        yield from _tree(part, t_ns, depth, holds)


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
            return None
        case _:
            assert_never(group.subject)


# --- the command, and what had to change -----------------------------------------------------------


def _sent_lines(explanation: Explanation) -> Iterator[str]:
    sent = explanation.sent
    if sent is None:
        return
    for cut in sent.cuts:
        yield _cut_text(cut)


def _cut_text(cut: Cut) -> str:
    by = "the range of the actuator" if cut.limit is None else f"the limit `{cut.limit}`"
    missing = "; the bound is missing, so the idle command's value stands in" if cut.is_missing else ""
    return f"{cut.field}: {cut.wanted} was cut to {cut.sent} by {by}{_details(cut.detail)}{missing}"


def _changes_lines(explanation: Explanation) -> Iterator[str]:
    changes = explanation.changes
    if not changes:
        yield "no other reading would have changed this"
        return
    texts = [listed([_name(leaf.cause) for leaf in change]) for change in changes]
    if len(changes) == 1 and len(changes[0]) == 1:
        yield f"to change this: {texts[0]}"
    elif len(changes) == 1:
        yield f"to change this, all of these: {texts[0]}"
    else:
        yield f"to change this, any of these: {'; '.join(texts)}"


def _name(cause: Cause) -> str:
    """Return a few words that name a condition."""
    match cause:
        case Comparison(condition=condition) | Reading(condition=condition) | Constant(condition=condition):
            return f"`{condition}`"
        case Remembered(condition=condition) | Unknown(condition=condition):
            return f"`{condition}`"
        case Past(function=function, condition=condition, duration_ns=duration_ns):
            return f"the past of `{function}({condition}, {duration_text(duration_ns)})`"
        case Present(sensor=sensor):
            return f"a reading of {sensor}"
        case TimeConstant(dominant=dominant):
            return f"the time constant of {dominant}"
        case Answered(module=module):
            return f"the answer of {module}"
        case Heard(module=module):
            return f"the client of {module}"
        case Undisturbed(actuator=actuator):
            return f"the command of {actuator} from outside"
        case Sendable(module=module):
            return f"the command of {module}"
        case _:
            assert_never(cause)
