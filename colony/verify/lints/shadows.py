"""Lint of modules that can be active but never get through, because others always dominate them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set

from colony.ir.expression import Expression
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import quoted
from colony.verify.claims import active, all_of, any_of, implies, negation, won
from colony.verify.lints.case import Case
from colony.verify.lints.predicates import never_active


def shadowed(module: str) -> str:
    """Return the name of the claim that a module never gets through."""
    return f"shadowed {module}"


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a module never gets through to an actuator, an inhibitor or a time constant."""
    exit_nodes = [n for n in case.network.nodes.values() if n.relation == "inhibits" or n.window_ns]
    for name in case.modules:
        exits: list[Expression] = [
            won(actuator, name)
            for actuator, root in case.network.roots.items()
            if case.network.is_under(name, root)
        ]
        too_deep = False
        for node in exit_nodes:
            if case.network.is_under(name, node.dominant):
                output_condition = case.network.output_condition(name, node.dominant)
                too_deep = too_deep or output_condition is None
                exits += [output_condition] if output_condition is not None else []
        if not too_deep:
            yield shadowed(name), negation(any_of(exits))


def dominated(case: Case, module: str, dominators: Sequence[str]) -> Expression | None:
    """Return the condition that one of `dominators` dominates an active module on each of its paths.

    None if this cannot be expressed, because of a time constant or a network that is too deep.
    """
    dominated_on_paths = []
    for node in case.network.nodes_above(module):
        if node.window_ns:
            return None
    for path in _paths(case, module):
        dominations = []
        for name in path:
            node = case.network.nodes[name]
            for dominator in dominators:
                if case.network.is_under(dominator, node.dominant):
                    condition = case.network.output_condition(dominator, node.dominant)
                    if condition is None:
                        return None
                    dominations.append(condition)
        dominated_on_paths.append(any_of(dominations))
    return implies(active(module), all_of(dominated_on_paths))


def _paths(case: Case, module: str) -> Iterator[tuple[str, ...]]:
    """Yield, for each path of a module to the end of a network, the nodes that it enters as inferior."""
    ends = [*case.network.roots.values()]
    ends += [n.dominant for n in case.network.nodes.values() if n.relation == "inhibits"]
    count = 0
    pending: list[tuple[str, tuple[str, ...]]] = [(end, ()) for end in ends]
    while pending and count < _MAX_PATHS:
        ref, passed = pending.pop()
        if ref == module:
            count += 1
            yield passed
        node = case.network.nodes.get(ref)
        if node is not None and case.network.is_under(module, ref):
            pending.append((node.inferior, (*passed, ref)))
            if node.relation == "suppresses":
                pending.append((node.dominant, passed))


_MAX_PATHS = 16


def findings(case: Case, proved: Set[str], dominators: Mapping[str, tuple[str, ...]]) -> Iterator[Diagnostic]:
    """Yield the warnings; `dominators` gives a minimal dominating set for each module, if one was found."""
    for name, module in case.modules.items():
        if shadowed(name) not in proved or never_active(name) in proved:
            continue
        names = dominators.get(name, ())
        if names:
            why = f"{quoted(names, 'or')} dominates it"
        else:
            why = f"something above it dominates: {quoted(case.network.dominators(name), 'or')}"
        yield warning(
            "V020",
            module.span,
            f"`{name}` can never get through: wherever it is active, {why}",
            "put it above what dominates it, narrow the predicates there, or remove the module",
        )
