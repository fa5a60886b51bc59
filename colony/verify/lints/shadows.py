"""Modules that can be active, and never get through: others dominate them wherever they stand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set

from colony.ir.expression import Expression
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import quoted
from colony.verify.claims import active, all_of, any_of, implies, negation, won
from colony.verify.lints.case import Case
from colony.verify.lints.predicates import never


def shadowed(module: str) -> str:
    """Return the name of the claim that a module never gets through."""
    return f"shadowed {module}"


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a module never gets through to an actuator, an inhibitor or a time constant."""
    for name in case.modules:
        ways: list[Expression] = [
            won(actuator, name)
            for actuator, root in case.network.roots.items()
            if name in case.network.under(root)
        ]
        deep = False
        for node in case.network.joints.values():
            if node.relation == "inhibits" or node.window_ns:
                way = case.network.emerges(name, node.dominant)
                deep = deep or way is None
                ways += [way] if way is not None else []
        if not deep:
            yield shadowed(name), negation(any_of(ways))


def dominated(case: Case, module: str, by: Sequence[str]) -> Expression | None:
    """Return the condition that one of `by` dominates an active module on each of its ways.

    None where that is too hard to express: a time constant may remember a module that has no name.
    """
    each = []
    for node in case.network.above(module):
        if node.window_ns:
            return None
    for way in _ways(case, module):
        cut = []
        for name in way:
            node = case.network.joints[name]
            for other in by:
                if other in case.network.under(node.dominant):
                    out = case.network.emerges(other, node.dominant)
                    if out is None:
                        return None
                    cut.append(out)
        each.append(any_of(cut))
    return implies(active(module), all_of(each))


def _ways(case: Case, module: str) -> Iterator[tuple[str, ...]]:
    """Yield, for each way of a module to the end of a network, the nodes that it enters as inferior."""
    ends = [*case.network.roots.values()]
    ends += [n.dominant for n in case.network.joints.values() if n.relation == "inhibits"]
    made = 0
    todo: list[tuple[str, tuple[str, ...]]] = [(end, ()) for end in ends]
    while todo and made < _MOST_WAYS:
        ref, passed = todo.pop()
        if ref == module:
            made += 1
            yield passed
        node = case.network.joints.get(ref)
        if node is not None and module in case.network.under(ref):
            todo.append((node.inferior, (*passed, ref)))
            if node.relation == "suppresses":
                todo.append((node.dominant, passed))


_MOST_WAYS = 16


def candidates(case: Case, module: str) -> tuple[str, ...]:
    """Return the modules that can dominate a module, the nearest first."""
    found: dict[str, None] = {}
    for node in case.network.above(module):
        found |= dict.fromkeys(x for x in case.network.under(node.dominant) if x != module)
    return tuple(found)


def told(case: Case, proved: Set[str], by: Mapping[str, tuple[str, ...]]) -> Iterator[Diagnostic]:
    """Yield the warnings; `by` gives a minimal set of modules that dominate a module, where it was found."""
    for name, module in case.modules.items():
        if shadowed(name) not in proved or never(name) in proved:
            continue
        who = by.get(name, ())
        if who:
            why = f"{quoted(who, 'or')} dominates it"
        else:
            why = (
                f"wherever it is active, something above it dominates: {quoted(candidates(case, name), 'or')}"
            )
        yield warning(
            "V020",
            module.span,
            f"`{name}` can never get through: wherever it is active, {why}",
            "put it above what dominates it, or narrow the predicates there; a module of no use can go",
        )
