"""Checking of the network: wires, cycles, and which modules may drive which actuator."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.expressions import ExpressionChecker
from colony.dsl.check.references import resolve_part
from colony.dsl.check.scope import ActuatorSymbol, BrokenSymbol, Report, Scope
from colony.ir import program as ir
from colony.record import Record, record


@record
class PendingWire(Record):
    """A wire as declared; `drives` is the actuator that it is assigned to, in the main file."""

    node: ast.WireDecl
    scope: Scope
    name: str
    drives: str | None


def check_wires(report: Report, pending: list[PendingWire]) -> list[ir.Wire]:
    """Return the wires, each after those that it uses; report cycles and misplaced operands."""
    wires: dict[str, ir.Wire] = {}
    places: dict[str, PendingWire] = {}
    for one in pending:
        checker = ExpressionChecker(scope=one.scope, report=report)
        wiring = _wiring(checker, one.node.wiring)
        if wiring is not None:
            span = checker.span(one.node.name)
            wires[one.name] = ir.Wire(name=one.name, wiring=wiring, actuator=one.drives, span=span)
            places[one.name] = one
    return _in_order(report, wires, places)


def _wiring(checker: Checker, node: ast.Wiring) -> ir.Wiring | None:
    """Check wiring. Only parentheses nest, and their depth is limited: chains are flat."""
    if isinstance(node, ast.Reference):
        part = resolve_part(checker, node)
        if isinstance(part, ActuatorSymbol):
            hint = "give the wiring that drives it a name of its own, and use that name"
            checker.error("E506", node, f"`{node.text}` is an actuator, not a wire", hint)
            return None
        if part is None or isinstance(part, BrokenSymbol):
            return None
        return ir.Use(name=part.name, span=checker.span(node))
    relations = {link.relation for link in node.links}
    if len(relations) > 1:
        _report_mixture(checker, node)
    operands = [_wiring(checker, operand) for operand in node.operands]
    windows = [_window(checker, link) for link in node.links]
    if len(relations) > 1 or any(o is None for o in operands) or any(w is None for w in windows):
        return None
    return ir.Chain(
        relation=node.links[0].relation,
        operands=tuple(o for o in operands if o is not None),
        windows_ns=tuple(w for w in windows if w is not None),
        span=checker.span(node),
    )


def _window(checker: Checker, link: ast.Link) -> int | None:
    return 0 if link.window is None else checker.duration_ns(link.window, "a time constant")


def _report_mixture(checker: Checker, node: ast.Chain) -> None:
    at = next(i for i, link in enumerate(node.links) if link.relation != node.links[0].relation)
    first, second = node.links[0].relation, node.links[at].relation
    text = checker.scope.file.source.text
    left, middle, right = (text[o.start : o.end] for o in node.operands[at - 1 : at + 2])
    if max(len(left), len(middle), len(right)) > 40:
        left, middle, right = "a", "b", "c"
    hint = (
        f"write `{left} {first} ({middle} {second} {right})` or `({left} {first} {middle}) {second} {right}`"
    )
    checker.error("E501", node.links[at], f"`{first}` and `{second}` are mixed without parentheses", hint)


# --- order and cycles ------------------------------------------------------------------------------


def uses(wiring: ir.Wiring) -> Iterator[ir.Use]:
    """Yield every use of a module or wire, from the left."""
    return _uses(wiring, lambda here: here.operands)


def _uses(wiring: ir.Wiring, followed: Callable[[ir.Chain], tuple[ir.Wiring, ...]]) -> Iterator[ir.Use]:
    """Yield the uses in the operands that are followed, from the left."""
    stack = [wiring]
    while stack:
        here = stack.pop()
        if isinstance(here, ir.Use):
            yield here
        else:
            stack.extend(reversed(followed(here)))


def _in_order(
    report: Report, wires: Mapping[str, ir.Wire], places: Mapping[str, PendingWire]
) -> list[ir.Wire]:
    """Sort wires depth first with an explicit stack; a wire that feeds itself is reported and left out."""
    order: list[ir.Wire] = []
    state: dict[str, str] = {}
    for root in wires:
        if root in state:
            continue
        state[root] = "open"
        stack = [(root, uses(wires[root].wiring))]
        while stack:
            name, rest = stack[-1]
            use = next(rest, None)
            if use is None:
                stack.pop()
                state[name] = "done"
                order.append(wires[name])
            elif use.name in wires and use.name not in state:
                state[use.name] = "open"
                stack.append((use.name, uses(wires[use.name].wiring)))
            elif state.get(use.name) == "open":
                trail = [n for n, _ in stack]
                cycle = [*trail[trail.index(use.name) :], use.name]
                _report_cycle(report, places[name], use, cycle)
    return order


def _report_cycle(report: Report, place: PendingWire, use: ir.Use, cycle: list[str]) -> None:
    shown = [f"`{name}`" for name in cycle[:6]]
    more = " uses ..." if len(cycle) > 6 else ""
    node = ast.Name(text=use.name, start=use.span.start, end=use.span.end)
    message = f"a wire feeds itself: {' uses '.join(shown)}{more}"
    report.error(place.scope, "E502", node, message, "the network must have no cycle")


# --- outputs of wirings ----------------------------------------------------------------------------


def check_outputs(
    report: Report,
    wires: list[ir.Wire],
    modules: Mapping[str, ir.AnyModule],
    scopes: Mapping[str, Scope],
) -> None:
    """Check that every module that can reach an actuator commands it; others may only inhibit.

    This follows each actuator's wiring, except the dominant sides of `inhibits`. Errors are reported where
    the actuator's own wiring names the wire that leads to the module.
    """
    by_name = {w.name: w for w in wires}
    for root in wires:
        if root.actuator is None:
            continue
        seen: set[str] = set()
        for use in _passing(root.wiring):
            wrong = _first_misfit(use, root.actuator, by_name, modules, seen)
            if wrong is not None:
                _report_misfit(report, scopes[root.name], use, wrong, root.actuator)


def _passing(wiring: ir.Wiring) -> Iterator[ir.Use]:
    """Yield the uses whose output may come out of the wiring, from the left."""
    return _uses(wiring, lambda here: here.operands if here.relation == "suppresses" else here.operands[-1:])


def _first_misfit(
    use: ir.Use,
    actuator: str,
    by_name: Mapping[str, ir.Wire],
    modules: Mapping[str, ir.AnyModule],
    seen: set[str],
) -> ir.AnyModule | None:
    """Return a module behind this use that does not command the actuator; `seen` is skipped."""
    stack = [use.name]
    while stack:
        name = stack.pop()
        if name in by_name and name not in seen:
            seen.add(name)
            stack.extend(u.name for u in _passing(by_name[name].wiring))
        elif name in modules and modules[name].actuator != actuator:
            return modules[name]
    return None


def _report_misfit(report: Report, scope: Scope, use: ir.Use, module: ir.AnyModule, actuator: str) -> None:
    node = ast.Name(text=use.name, start=use.span.start, end=use.span.end)
    subject = (
        f"`{module.name}`" if use.name == module.name else f"`{use.name}` leads to `{module.name}`, which"
    )
    misplaced = f"but is used where it would drive `{actuator}`"
    if module.actuator is None:
        hint = "a module without `do` may be used only on the dominant side of an `inhibits`"
        report.error(scope, "E504", node, f"{subject} commands nothing, {misplaced}", hint)
    else:
        hint = "all modules under one wiring command the same actuator, dominant sides of `inhibits` aside"
        report.error(scope, "E505", node, f"{subject} commands `{module.actuator}`, {misplaced}", hint)


def reached(wires: list[ir.Wire]) -> set[str]:
    """Return the modules and wires that take part in the decision of some actuator."""
    by_name = {w.name: w for w in wires}
    found: set[str] = set()
    stack = [w.name for w in wires if w.actuator is not None]
    while stack:
        name = stack.pop()
        if name in found:
            continue
        found.add(name)
        if name in by_name:
            stack.extend(u.name for u in uses(by_name[name].wiring))
    return found
