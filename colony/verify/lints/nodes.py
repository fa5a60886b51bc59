"""Lint of inhibitors and time constants that change nothing."""

from __future__ import annotations

from collections.abc import Iterator, Set

from colony.ir.expression import Expression
from colony.ir.wiring import WiringNode
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import duration_text, quoted
from colony.verify.claims import active, all_of, implies, negation
from colony.verify.lints.case import Case, span_of, text_of
from colony.verify.lints.predicates import never_active
from colony.verify.lints.shadows import shadowed


def _useless_inhibitor(node: WiringNode) -> str:
    return f"inhibits nothing {node.name}"


def _useless_window(node: WiringNode) -> str:
    return f"no time {node.name}"


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a node has no effect.

    An inhibitor has none if its inferior gets through whenever the inferior is active; a time constant has
    none if that holds while the dominant side is not active. A suppressor whose sides exclude each other is
    not a finding: it merges them.
    """
    for node in _own_nodes(case):
        passes = active(node.name)
        if node.relation == "inhibits":
            yield _useless_inhibitor(node), implies(active(node.inferior), passes)
        if node.window_ns:
            only_inferior = all_of((active(node.inferior), negation(active(node.dominant))))
            yield _useless_window(node), implies(only_inferior, passes)


def _own_nodes(case: Case) -> Iterator[WiringNode]:
    for node in case.network.nodes.values():
        if case.is_own(span_of(node)):
            yield node


def findings(case: Case, proved: Set[str]) -> Iterator[Diagnostic]:
    """Yield the warnings about nodes without effect."""
    for node in _own_nodes(case):
        if not proved & {_useless_inhibitor(node), _useless_window(node)}:
            continue
        sides = [case.network.modules_under(node.dominant), case.network.modules_under(node.inferior)]
        if any(all(never_active(m) in proved or shadowed(m) in proved for m in side) for side in sides):
            continue  # other lints report these modules
        dominant, inferior = (quoted(side) for side in sides)
        verb = "is" if len(sides[1]) == 1 else "are"
        if _useless_inhibitor(node) in proved:
            yield warning(
                "V023",
                span_of(node),
                f"`{text_of(node)}` changes nothing: where {dominant} would inhibit, "
                f"{inferior} {verb} not active",
                "remove the inhibitor, or correct a predicate",
            )
        elif _useless_window(node) in proved:
            yield warning(
                "V024",
                span_of(node),
                f"the time constant of `{text_of(node)}` changes nothing: within "
                f"{duration_text(node.window_ns)} after {dominant}, {inferior} {verb} not active",
                "remove the time constant, or correct a predicate",
            )
