"""Lint of time constants within a dominant side, which hold back only their own inferior side."""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir.expression import Expression
from colony.ir.wiring import WiringNode
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import duration_text, quoted
from colony.verify.claims import active, all_of, any_of, negation, won
from colony.verify.lints.case import Case, span_of
from colony.verify.lints.proof import Prover, asked


def _name(inner: WiringNode, outer: WiringNode) -> str:
    return f"pause {inner.name} {outer.name}"


def _pairs(case: Case) -> Iterator[tuple[WiringNode, WiringNode]]:
    """Yield the inner and the outer node of each `(A suppresses[T] B) suppresses C`."""
    for outer in case.network.nodes.values():
        inner = case.network.nodes.get(outer.dominant)
        if inner is None or not inner.window_ns or not case.is_own(span_of(outer)):
            continue
        if inner.relation == outer.relation == "suppresses":
            yield inner, outer


def _claim(case: Case, inner: WiringNode, outer: WiringNode) -> Expression:
    """Return the claim that no inferior of the outer node wins while the inner one holds back its own."""
    below = [
        won(actuator, module)
        for actuator, root in case.network.roots.items()
        for module in case.network.modules_under(outer.inferior)
        if case.network.is_under(module, root) and not case.network.is_under(module, inner.name)
    ]
    held_back = (active(inner.inferior), negation(active(inner.dominant)), negation(active(inner.name)))
    return negation(all_of((*held_back, any_of(below))))


def findings(case: Case, prover: Prover) -> Iterator[Diagnostic]:
    """Yield the warnings about pauses that let other modules through."""
    for inner, outer in _pairs(case):
        if prover.refuted(asked(_name(inner, outer), _claim(case, inner, outer))) is None:
            continue
        first, held_back, passing = (
            quoted(case.network.modules_under(ref))
            for ref in (inner.dominant, inner.inferior, outer.inferior)
        )
        is_plural = len(case.network.modules_under(inner.inferior)) > 1
        is_, dominates = ("are", "they dominate") if is_plural else ("is", "it dominates")
        time = duration_text(inner.window_ns)
        yield warning(
            "V031",
            span_of(outer),
            f"within {time} after {first}, {held_back} {is_} held back, and {passing}, which {dominates}, "
            "gets through",
            f"put the time constant where it holds all of them back: `A suppresses[{time}] (B suppresses C)`",
        )
