"""Lint of predicates that never hold, or always hold, whatever the sensors read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from functools import partial
from itertools import combinations

from colony.ir.expression import Binary, Expression
from colony.ir.program import Module
from colony.ir.walk import WiringNode
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import duration_text, quoted
from colony.verify.claims import active, all_of, any_of, binary, fresh, implies, negation, source_text, won
from colony.verify.contracts.concrete_runs import GeneratedRuns
from colony.verify.lints.case import Case, span_of, text_of
from colony.verify.lints.proof import LintProver, Question

# --- predicates ----------------------------------------------------------------------------------------


def never_active(module: str) -> str:
    """Return the name of the claim that a module is never active."""
    return f"never {module}"


def always_active(module: str) -> str:
    """Return the name of the claim that a module is always active."""
    return f"always {module}"


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a module is never active and, if its predicate reads anything, always active."""
    for name, module in case.modules.items():
        yield never_active(name), negation(active(name))
        if case.is_own(module.span) and case.has_inputs(module):
            all_present = all_of(fresh(s) for s in sorted(case.contents.needs(module)))
            yield always_active(name), implies(all_present, active(name))


def findings(case: Case, proved: Set[str]) -> Iterator[Diagnostic]:
    """Yield the warnings about constant predicates."""
    for name, module in case.own_modules.items():
        if not case.has_inputs(module):
            continue
        predicate = source_text(module.when)
        if never_active(name) in proved:
            yield warning(
                "V021",
                module.when.span,
                f"`{name}` is never active: its predicate `{predicate}` is false whatever the sensors read",
                "correct the predicate: compare it with the ranges of the sensors that it reads",
            )
        elif always_active(name) in proved:
            needed = sorted(case.contents.needs(module))
            while_ = f" while {', '.join(f'`{s}`' for s in needed)} is present" if len(needed) == 1 else ""
            while_ = while_ or (" while everything that it reads is present" if needed else "")
            yield warning(
                "V022",
                module.when.span,
                f"`{name}` is always active{while_}: its predicate `{predicate}` is true whatever the "
                "sensors read",
                "write `when true` if that is intended; otherwise correct the predicate",
            )


# --- shadows -------------------------------------------------------------------------------------------
#
# Lint of modules that can be active but never get through, because others always dominate them.


def shadowed(module: str) -> str:
    """Return the name of the claim that a module never gets through."""
    return f"shadowed {module}"


def shadows_claims(case: Case) -> Iterator[tuple[str, Expression]]:
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


def shadows_findings(
    case: Case, proved: Set[str], dominators: Mapping[str, tuple[str, ...]]
) -> Iterator[Diagnostic]:
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


# --- nodes ---------------------------------------------------------------------------------------------
#
# Lint of inhibitors and time constants that change nothing.


def _useless_inhibitor(node: WiringNode) -> str:
    return f"inhibits nothing {node.name}"


def _useless_window(node: WiringNode) -> str:
    return f"no time {node.name}"


def nodes_claims(case: Case) -> Iterator[tuple[str, Expression]]:
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


def nodes_findings(case: Case, proved: Set[str]) -> Iterator[Diagnostic]:
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


# --- synchronized --------------------------------------------------------------------------------------
#
# Lint of two modules of one actuator that are always active at the same time.


def synchronized_findings(
    case: Case, proved: Set[str], activity: Mapping[str, int], prover: LintProver, runs: GeneratedRuns | None
) -> Iterator[Diagnostic]:
    """Yield the warnings about modules that are always active together.

    Modules with different `activity` in runs are not, and modules with another finding need no question. A
    frame that separates two modules often separates others, too.
    """
    seen = dict(activity)
    groups: dict[tuple[str | None, int], list[Module]] = {}
    for m in case.own_modules.values():
        other_findings = {claim(m.name) for claim in (never_active, always_active, shadowed)}
        if m.command is not None and case.has_inputs(m) and not other_findings & proved:
            groups.setdefault((m.actuator, seen[m.name]), []).append(m)
    for a, b in (pair for group in groups.values() for pair in combinations(group, 2)):
        if seen[a.name] != seen[b.name]:
            continue
        together = partial(binary, Binary.EQUAL, active(a.name), active(b.name))
        question = Question(f"together {a.name} {b.name}", together)
        is_proved = bool(prover.proved([question]))
        frame = prover.broken_start(question.name)
        for outcome in runs.outcomes([frame]) if runs is not None and frame is not None else ():
            seen = {m: x << 1 | (never_active(m) in outcome.breaches) for m, x in seen.items()}
        if is_proved:
            yield warning(
                "V029",
                b.span,
                f"`{a.name}` and `{b.name}` are always active together, and both command `{a.actuator}`",
                "merge them into one module, or make their predicates differ",
            )
