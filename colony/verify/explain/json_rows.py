"""Explanations as plain dicts and lists, for programs; docs/explain.md describes the keys."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, assert_never

from colony.text.source import Span
from colony.text.wording import listed, seconds_of
from colony.verify.explain.answer import Explanation, Question, SentOutcome, Whether, Why, WhyNot
from colony.verify.explain.causes import Cause, ConstantCondition, SimpleCondition, UnknownCondition
from colony.verify.explain.formula import Formula, Leaf
from colony.verify.explain.text import (
    MAX_LEVEL,
    MAX_PARTS,
    ExplainedTime,
    cause_text,
    changes_texts,
    head_text,
    lines,
    shown_parts,
)


def row(explanation: Explanation, begin_ns: int = 0) -> dict[str, Any]:
    """Return an answer as an object for JSON; times count from `begin_ns`."""
    module, now = explanation.module, ExplainedTime(explanation.t_ns, begin_ns)
    return {
        "question": _question(explanation.question),
        "frame": explanation.k,
        "t": seconds_of(explanation.t_ns - begin_ns),
        "claim": explanation.claim,
        "holds": explanation.holds,
        "answer": explanation.answer,
        "module": None
        if module is None
        else {
            "name": module[0],
            "status": module[1].value,
            "since": None if module[1].first else seconds_of(module[1].t_ns - begin_ns),
        },
        "sent": None if explanation.sent is None else _sent(explanation.sent),
        "because": _because(explanation.formula, now, 0),
        "changes": [
            {
                "certain": change.is_certain,
                "text": listed(changes_texts(change)),
                "conditions": [
                    _cause(leaf.cause, leaf.holds, now, leaf.span) for leaf in change.leaves[:MAX_PARTS]
                ],
            }
            for change in explanation.changes
        ],
        "lines": list(lines(explanation, begin_ns)),
    }


def _question(question: Question) -> dict[str, str]:
    match question:
        case Why(subject=subject):
            return {"kind": "why", "subject": subject}
        case WhyNot(subject=subject):
            return {"kind": "why not", "subject": subject}
        case Whether(condition=condition):
            return {"kind": "condition", "subject": condition}
        case _:
            assert_never(question)


def _because(formula: Formula, now: ExplainedTime, depth: int) -> list[dict[str, Any]]:
    """Return an object for each condition that decided, with those that it rests on as `because`."""
    if isinstance(formula, Leaf):
        return [] if formula.implied else [_cause(formula.cause, formula.holds, now, formula.span)]
    if depth > MAX_LEVEL:
        return []
    below = [found for part in shown_parts(formula)[:MAX_PARTS] for found in _because(part, now, depth + 1)]
    text = head_text(formula)
    if text is None:
        return below
    head = {
        "kind": formula.subject,
        "name": formula.name,
        "holds": formula.holds,
        "text": text,
        "at": _place(formula.span),
    }
    return [{**head, "because": below}]


_KINDS: dict[type, str] = {
    SimpleCondition: "reading", ConstantCondition: "constant", UnknownCondition: "unknown"
}  # fmt: skip
"""Kinds that have another name than their class."""


def _cause(cause: Cause, holds: bool, now: ExplainedTime, span: Span | None) -> dict[str, Any]:
    members = {f.name: getattr(cause, f.name) for f in fields(cause)}
    for name in {"at_ns", "since_ns"} & members.keys():
        members[name] = None if members[name] is None else members[name] - now.begin_ns
    kind = _KINDS.get(type(cause)) or type(cause).__name__.lower()
    text = cause_text(cause, holds, now)
    return {"kind": kind, "holds": holds, "text": text, "at": _place(span), **members}


def _place(span: Span | None) -> str | None:
    """Return `file:line:column`, None for what is in no file."""
    return repr(span) if span is not None and span.source.text else None


def _sent(sent: SentOutcome) -> dict[str, Any]:
    return {
        "actuator": sent.decision.actuator,
        "by": sent.decision.by,
        "values": None if sent.decision.values is None else list(sent.decision.values),
        "fault": sent.decision.fault,
        "outside": sent.outside,
        "hold": sent.hold,
        "missed": dict(sent.late),
        "cuts": [
            {
                "field": cut.field,
                "wanted": cut.wanted,
                "sent": cut.sent,
                "limit": cut.limit,
                "bound_missing": cut.is_missing,
                "detail": list(cut.detail),
                "at": _place(cut.span),
            }
            for cut in sent.cuts
        ],
    }
