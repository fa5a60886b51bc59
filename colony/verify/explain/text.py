"""Explanations as lines of text; `causes_text.py` and `changes_text.py` make the sentences of conditions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import assert_never

from colony.text.wording import listed
from colony.verify.explain.answer import Explanation, Whether
from colony.verify.explain.causes import Constant
from colony.verify.explain.causes_text import FrameTime, cause_text, detail_text, truth_text
from colony.verify.explain.changes_text import MAX_PARTS, changes_texts
from colony.verify.explain.command import Cut
from colony.verify.explain.formula import Formula, Group, Leaf, deciding_parts

MAX_DEPTH = 10
"""Maximum depth of the lines of an answer."""

MAX_LEVEL = 100
"""Maximum depth of the conditions below each other that are followed, with or without a line."""


def lines(explanation: Explanation, begin_ns: int = 0) -> tuple[str, ...]:
    """Return an answer as lines of text: the claim, the conditions indented below it, what had to change.

    Times count from `begin_ns`.
    """
    formula, now = explanation.formula, FrameTime(explanation.t_ns, begin_ns)
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
    texts = list(dict.fromkeys(_short(explanation.formula, FrameTime(explanation.t_ns))))
    if len(texts) > MAX_CAUSES:
        texts[MAX_CAUSES - 1 : -1] = [f"{len(texts) - MAX_CAUSES} more"]
    return "; ".join(texts)


def _short(formula: Formula, now: FrameTime, level: int = 0) -> Iterator[str]:
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


def _since_lines(explanation: Explanation, now: FrameTime) -> Iterator[str]:
    """Yield since when the module is as it is, if the run shows it."""
    if explanation.module is not None:
        name, since = explanation.module
        if not since.first and since.t_ns < explanation.t_ns:
            yield f"{name} is {since.value} since {now.ago(since.t_ns)}"


# --- the tree of conditions ------------------------------------------------------------------------


def _tree(formula: Formula, now: FrameTime, depth: int, level: int = 0) -> Iterator[str]:
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
            if len(below) == 1 and isinstance(below[0], Leaf) and isinstance(below[0].cause, Constant):
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
