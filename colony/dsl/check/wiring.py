"""Checking of the network: wires, cycles, and which modules may drive which actuator."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.expressions import ExpressionChecker
from colony.dsl.check.references import resolve_network_symbol
from colony.dsl.check.scope import ActuatorSymbol, BrokenSymbol, CheckReport, FileScope
from colony.ir import program as ir
from colony.record import Record, record


@record
class PendingWire(Record):
    """A wire as declared; `actuator` is the actuator that it drives, if it is in the main file."""

    node: ast.WireDecl
    scope: FileScope
    name: str
    actuator: str | None


def check_wires(report: CheckReport, pending: list[PendingWire]) -> list[ir.Wire]:
    """Return the wires, each after those that it uses; report cycles and misused operands."""
    wires: dict[str, ir.Wire] = {}
    declarations: dict[str, PendingWire] = {}
    for wire in pending:
        checker = ExpressionChecker(scope=wire.scope, report=report)
        wiring = _wiring(checker, wire.node.wiring)
        if wiring is not None:
            span = checker.span(wire.node.name)
            wires[wire.name] = ir.Wire(name=wire.name, wiring=wiring, actuator=wire.actuator, span=span)
            declarations[wire.name] = wire
    return _in_order(report, wires, declarations)


def _wiring(checker: Checker, node: ast.Wiring) -> ir.Wiring | None:
    """Check a wiring. The recursion is limited by the nesting depth of parentheses, as chains are flat."""
    if isinstance(node, ast.Reference):
        symbol = resolve_network_symbol(checker, node)
        if isinstance(symbol, ActuatorSymbol):
            hint = "give the wiring that drives it a name of its own, and use that name"
            checker.error("E506", node, f"`{node.text}` is an actuator, not a wire", hint)
            return None
        if symbol is None or isinstance(symbol, BrokenSymbol):
            return None
        return ir.Use(name=symbol.name, span=checker.span(node))
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


def _window(checker: Checker, link: ast.LinkNode) -> int | None:
    return 0 if link.window is None else checker.duration_ns(link.window, "a time constant")


def _report_mixture(checker: Checker, node: ast.ChainNode) -> None:
    second_link = next(i for i, link in enumerate(node.links) if link.relation != node.links[0].relation)
    first, second = node.links[0].relation, node.links[second_link].relation
    text = checker.scope.file.source.text
    left, center, right = (text[o.start : o.end] for o in node.operands[second_link - 1 : second_link + 2])
    if max(len(left), len(center), len(right)) > 40:
        left, center, right = "a", "b", "c"
    hint = (
        f"write `{left} {first} ({center} {second} {right})` or `({left} {first} {center}) {second} {right}`"
    )
    checker.error(
        "E501", node.links[second_link], f"`{first}` and `{second}` are mixed without parentheses", hint
    )


# --- order and cycles ------------------------------------------------------------------------------


def uses(wiring: ir.Wiring) -> Iterator[ir.Use]:
    """Yield every use of a module or wire, from left to right."""
    return _uses(wiring, lambda chain: chain.operands)


def _uses(
    wiring: ir.Wiring, operands_to_follow: Callable[[ir.Chain], tuple[ir.Wiring, ...]]
) -> Iterator[ir.Use]:
    """Yield the uses in the operands that `operands_to_follow` returns, from left to right."""
    stack = [wiring]
    while stack:
        chain = stack.pop()
        if isinstance(chain, ir.Use):
            yield chain
        else:
            stack.extend(reversed(operands_to_follow(chain)))


def _in_order(
    report: CheckReport, wires: Mapping[str, ir.Wire], declarations: Mapping[str, PendingWire]
) -> list[ir.Wire]:
    """Sort wires depth first with an explicit stack; report wires that feed themselves."""
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
                path = [n for n, _ in stack]
                cycle = [*path[path.index(use.name) :], use.name]
                _report_cycle(report, declarations[name], use, cycle)
    return order


def _report_cycle(report: CheckReport, declaration: PendingWire, use: ir.Use, cycle: list[str]) -> None:
    shown = [f"`{name}`" for name in cycle[:6]]
    more = " uses ..." if len(cycle) > 6 else ""
    node = ast.NameNode(text=use.name, start=use.span.start, end=use.span.end)
    message = f"a wire feeds itself: {' uses '.join(shown)}{more}"
    report.error(declaration.scope, "E502", node, message, "the network must have no cycle")


# --- outputs of wirings ----------------------------------------------------------------------------


def check_outputs(
    report: CheckReport,
    wires: list[ir.Wire],
    modules: Mapping[str, ir.AnyModule],
    scopes: Mapping[str, FileScope],
) -> None:
    """Check that every module that can reach an actuator commands it; others may only inhibit.

    This follows each actuator's wiring, except the dominant sides of `inhibits`. Errors are reported at the
    operand of the actuator's own wiring that leads to the module.
    """
    by_name = {w.name: w for w in wires}
    for root in wires:
        if root.actuator is None:
            continue
        seen: set[str] = set()
        for use in _uses_passed_on(root.wiring):
            misfit = _first_misfit(use, root.actuator, by_name, modules, seen)
            if misfit is not None:
                _report_misfit(report, scopes[root.name], use, misfit, root.actuator)


def _uses_passed_on(wiring: ir.Wiring) -> Iterator[ir.Use]:
    """Yield the uses whose output the wiring can pass on, from left to right."""
    return _uses(
        wiring, lambda chain: chain.operands if chain.relation == "suppresses" else chain.operands[-1:]
    )


def _first_misfit(
    use: ir.Use,
    actuator: str,
    by_name: Mapping[str, ir.Wire],
    modules: Mapping[str, ir.AnyModule],
    seen: set[str],
) -> ir.AnyModule | None:
    """Return a module behind this use that does not command the actuator; skip names in `seen`."""
    stack = [use.name]
    while stack:
        name = stack.pop()
        if name in by_name and name not in seen:
            seen.add(name)
            stack.extend(u.name for u in _uses_passed_on(by_name[name].wiring))
        elif name in modules and modules[name].actuator != actuator:
            return modules[name]
    return None


def _report_misfit(
    report: CheckReport, scope: FileScope, use: ir.Use, module: ir.AnyModule, actuator: str
) -> None:
    node = ast.NameNode(text=use.name, start=use.span.start, end=use.span.end)
    subject = (
        f"`{module.name}`" if use.name == module.name else f"`{use.name}` leads to `{module.name}`, which"
    )
    misplaced = f"but is used where it would drive `{actuator}`"
    if module.actuator is None:
        hint = "a module without `do` may be used only on the dominant side of an `inhibits`"
        report.error(scope, "E504", node, f"{subject} commands nothing, {misplaced}", hint)
    else:
        hint = (
            "all modules of one wiring must command the same actuator, except on dominant sides of `inhibits`"
        )
        report.error(scope, "E505", node, f"{subject} commands `{module.actuator}`, {misplaced}", hint)


def names_reaching_actuators(wires: list[ir.Wire]) -> set[str]:
    """Return the names of the modules and wires that can influence an actuator."""
    by_name = {w.name: w for w in wires}
    names: set[str] = set()
    stack = [w.name for w in wires if w.actuator is not None]
    while stack:
        name = stack.pop()
        if name in names:
            continue
        names.add(name)
        if name in by_name:
            stack.extend(u.name for u in uses(by_name[name].wiring))
    return names
