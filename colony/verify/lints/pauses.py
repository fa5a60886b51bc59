"""The pause of a time constant inside of a dominant side: it holds its own inferior, and nobody else's."""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir.expression import Expression
from colony.text.diagnostics import Diagnostic, warning
from colony.verify.lints.case import Case
from colony.verify.lints.claims import active, all_of, any_of, named, negation, won
from colony.verify.lints.network import Node
from colony.verify.lints.proof import Prover


def _name(inner: Node, outer: Node) -> str:
    return f"pause {inner.name} {outer.name}"


def _pairs(case: Case) -> Iterator[tuple[Node, Node]]:
    """`(A suppresses[T] B) suppresses C`: the inner node, and the outer one."""
    for outer in case.network.nodes.values():
        inner = case.network.nodes.get(outer.dominant)
        if inner is None or not inner.window_ns or not case.is_own(outer.span):
            continue
        if inner.relation == outer.relation == "suppresses":
            yield inner, outer


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """That while the inner node holds its inferior back, no module below the outer one wins."""
    for inner, outer in _pairs(case):
        below = [
            won(actuator, module)
            for actuator, root in case.network.roots.items()
            for module in case.network.under(outer.inferior)
            if module in case.network.under(root) and module not in case.network.under(inner.name)
        ]
        held = (active(inner.inferior), negation(active(inner.dominant)), negation(active(inner.name)))
        yield _name(inner, outer), negation(all_of((*held, any_of(below))))


def told(case: Case, prover: Prover) -> Iterator[Diagnostic]:
    for inner, outer in _pairs(case):
        if prover.refuted(_name(inner, outer)) is None:
            continue
        first, held, lesser = (
            named(case.network.under(ref), "and") for ref in (inner.dominant, inner.inferior, outer.inferior)
        )
        many = len(case.network.under(inner.inferior)) > 1
        is_, dominates = ("are", "they dominate") if many else ("is", "it dominates")
        time = f"{inner.window_ns / 1e9:g} s"
        yield warning(
            "V031",
            outer.span,
            f"within {time} after {first}, {held} {is_} held back, and {lesser}, which {dominates}, "
            "gets through",
            f"put the time constant where it holds all: `A suppresses[{time}] (B suppresses C)`",
        )
