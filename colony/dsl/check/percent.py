"""Plain numbers where a value in percent is meant: `battery > 20` means 2000 percent.

A percent is the plain number 0.01, so the types agree; what stands beside a value declared in percent shows
what was meant.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import chain

from colony.dsl import ast
from colony.dsl.check.scope import InPercent, Report
from colony.ir import expression as ir
from colony.ir.program import Let, Module, Program, State
from colony.ir.walk import expressions
from colony.text.diagnostics import Diagnostic, Label, error
from colony.text.source import Span

PERCENT = "percent"

_PLAIN = re.compile(r"[0-9][0-9.eE+-]*")
_COMPARISONS = frozenset(
    {
        ir.Binary.LESS,
        ir.Binary.LESS_EQUAL,
        ir.Binary.GREATER,
        ir.Binary.GREATER_EQUAL,
        ir.Binary.EQUAL,
        ir.Binary.NOT_EQUAL,
    }
)
_SUMS = frozenset({ir.Binary.ADD, ir.Binary.SUBTRACT})
_JOINED = _COMPARISONS | _SUMS
_COMPARED = frozenset({ir.Function.MIN, ir.Function.MAX, ir.Function.CLAMP})
_SAME_UNIT = _COMPARED | {ir.Function.SUM, ir.Function.MEAN, ir.Function.ABS}

PlainParams = frozenset[tuple[str, float]]
"""The names of params that are declared or given as plain numbers, each with the number.

Params of several modules with the same name and number are not told apart. That is good enough: the number is
above 1, so that one of them is right only if it is written as more than 100 percent.
"""


def plain_params(trees: Iterable[ast.File]) -> PlainParams:
    """Return the params of these files that are declared, or given to a derived module, as plain numbers."""
    found: set[tuple[str, float]] = set()
    for tree in trees:
        for node in tree.declarations:
            named: Iterable[ast.ParamDecl | ast.Argument] = ()
            match node:
                case ast.ParamDecl():
                    named = (node,)
                case ast.ModuleDecl(clauses=clauses):
                    named = [c for c in clauses if isinstance(c, ast.ParamDecl)]
                case ast.DerivedModuleDecl(arguments=arguments):
                    named = arguments
                case _:
                    pass
            for param in named:
                if isinstance(param.value, ast.Number) and param.value.unit is None:
                    found.add((param.name.text, float(param.value.digits)))
    return frozenset(found)


def note_unit(report: Report, shown: str, unit: str, place: Span, value: ir.Expression) -> None:
    """Add what is given a value to the report if it is declared in percent.

    Args:
        report: the collector.
        shown: what it is, for messages.
        unit: its declared unit.
        place: the span of a state, or of what a parameter or input stands for.
        value: the value given to it.
    """
    if unit == PERCENT:
        report.percents.append(InPercent(shown=shown, place=place, value=value))


def percent_findings(
    program: Program, params: PlainParams, percents: Sequence[InPercent]
) -> Iterator[Diagnostic]:
    """Yield an error for each plain number beyond 1 beside a value that is declared in percent."""
    units = _Units(program, percents)
    if not units.declares_percent():
        return
    found: dict[Span, Diagnostic] = {}
    for diagnostic in _all_findings(program, params, units):
        found.setdefault(diagnostic.span, diagnostic)
    yield from found.values()


def _all_findings(program: Program, params: PlainParams, units: _Units) -> Iterator[Diagnostic]:
    steps = chain.from_iterable(example.steps for example in program.tests)
    expectations = chain.from_iterable(step.expectations for step in steps)
    for root in chain(expressions(program), expectations):
        for node in ir.subexpressions(root):
            units.enter(node)
            for value, numbers in _neighbors(node):
                if units.in_percent(value):
                    is_inlined = not all(_is_inside(n.span, node.span) for n in (value, *numbers))
                    origin = (Label(value.span, "given here"),) if is_inlined else ()
                    yield from _findings(units.shown(value.span), numbers, params, *origin)
    given = ((p.shown, p.value) for p in units.percents)
    for where, value in chain(given, _limits(program, units), _commands(program, units), units.nexts):
        yield from _findings(where, (value,), params)


def _neighbors(node: ir.Expression) -> Iterator[tuple[ir.Expression, tuple[ir.Expression, ...]]]:
    """Yield each operand of a comparison, a sum or a choice, with the others: they have its unit."""
    match node:
        case ir.BinaryOperation(operator=operator, left=left, right=right) if operator in _JOINED:
            yield left, (right,)
            yield right, (left,)
        case ir.Conditional(yes=yes, no=no):
            yield yes, (no,)
            yield no, (yes,)
        case ir.Within(operand=operand, low=low, high=high):
            yield operand, (low, high)
        case ir.ValueOr(expression=expression, other=other):
            yield expression, (other,)
        case ir.MemoryCall(function=ir.MemoryFunction.PREVIOUS, arguments=(value, initial)):
            yield value, (initial,)
        case ir.Call(function=function, arguments=arguments) if function in _COMPARED:
            for value in arguments:
                yield value, tuple(other for other in arguments if other is not value)
        case _:
            pass


def _parts(node: ir.Expression) -> tuple[ir.Expression, ...]:
    """Return the parts of an expression that have its unit."""
    match node:
        case ir.Element(array=array) | ir.Slice(array=array) | ir.Window(array=array):
            return (array,)
        case ir.ValueOr(expression=expression, other=other):
            return expression, other
        case ir.Reduce(function=function, body=body) if function in _SAME_UNIT:
            return (body,)
        case ir.UnaryOperation(operand=operand):
            return (operand,)
        case ir.BinaryOperation(operator=operator, left=left, right=right) if operator in _SUMS:
            return left, right
        case ir.Conditional(yes=yes, no=no):
            return yes, no
        case ir.Call(function=function, arguments=arguments) if function in _SAME_UNIT:
            return arguments
        case ir.MemoryCall(function=ir.MemoryFunction.PREVIOUS, arguments=arguments):
            return arguments
        case ir.MemoryCall(function=ir.MemoryFunction.CAPTURED, arguments=(captured, _)):
            return (captured,)
        case _:
            return ()


def _limits(program: Program, units: _Units) -> Iterator[tuple[str, ir.Expression]]:
    for limit in program.limits:
        if units.field_in_percent(limit.actuator, limit.field_index):
            field = units.actuators[limit.actuator].fields[limit.field_index]
            yield f"`{limit.actuator}.{field.name}`", limit.bound


def _commands(program: Program, units: _Units) -> Iterator[tuple[str, ir.Expression]]:
    for module in program.modules:
        if isinstance(module, Module) and module.command is not None:
            actuator = units.actuators[module.command.actuator]
            for field, value in zip(actuator.fields, module.command.fields, strict=True):
                if field.unit == PERCENT:
                    yield f"`{actuator.name}.{field.name}`", value


def _findings(
    what: str, numbers: Iterable[ir.Expression], params: Collection[tuple[str, float]], *origin: Label
) -> Iterator[Diagnostic]:
    for node in numbers:
        yield from _findings(what, _parts(node), params, *origin)
        if not isinstance(node, ir.Constant) or not isinstance(node.value, float) or not node.value > 1:
            continue
        written, number = node.span.text, f"{node.value:.15g}"
        if _PLAIN.fullmatch(written):
            found, hint = written, f"write `{written} percent`"
        elif (written.rpartition(".")[2], node.value) in params:
            found, hint = f"`{written}`, which is {number},", f"write `{number} percent` where it is declared"
        else:
            continue
        message = f"{what} is in percent: {found} means {node.value * 100:.15g} percent"
        yield error("E220", node.span, message, hint, *origin)


def _is_inside(part: Span, whole: Span) -> bool:
    return part.source is whole.source and whole.start <= part.start and part.end <= whole.end


class _Units:
    """What a program declares in percent, and what is computed from it alone.

    Attributes:
        actuators: the actuators of the robot by name.
        percents: what is declared in percent and given a value.
        nexts: the states in percent, as shown in messages, with their next values.
    """

    def __init__(self, program: Program, percents: Sequence[InPercent]) -> None:
        self.actuators = {actuator.name: actuator for actuator in program.robot.actuators}
        self.nexts: list[tuple[str, ir.Expression]] = []
        self.percents = percents
        self._shown = {p.place: p.shown for p in percents}
        self._values = {sensor.name for sensor in program.robot.sensors if sensor.unit == PERCENT}
        self._elements: set[str] = set()
        modules = [m for m in program.modules if isinstance(m, Module)]
        for state in chain(program.derived, *(m.states for m in modules)):
            if isinstance(state, State) and state.span in self._shown:
                self._values.add(state.name)
                self.nexts += [] if state.next is None else [(f"`{state.name}`", state.next)]
        for let in chain(program.derived, *(m.lets for m in modules)):  # each after those that it reads
            if isinstance(let, Let) and self.in_percent(let.expression):
                self._values.add(let.name)

    def declares_percent(self) -> bool:
        """Return True if anything is declared in percent."""
        fields = (field for actuator in self.actuators.values() for field in actuator.fields)
        return bool(self._values or self.percents) or any(field.unit == PERCENT for field in fields)

    def field_in_percent(self, actuator: str, index: int) -> bool:
        """Return True if a field of an actuator is declared in percent."""
        return self.actuators[actuator].fields[index].unit == PERCENT

    def shown(self, span: Span) -> str:
        """Return a value in percent for messages: by the name of what it is given to, or as written."""
        written = "the other operand" if len(span.text) > 40 or "\n" in span.text else f"`{span.text}`"
        return self._shown.get(span, written)

    def enter(self, node: ir.Expression) -> None:
        """Look at the arrays of a reduction before its body, in which their elements have names."""
        if isinstance(node, ir.Reduce):
            for name, array in node.arrays:
                (self._elements.add if self.in_percent(array) else self._elements.discard)(name)

    def in_percent(self, node: ir.Expression) -> bool:
        """Return True if an expression has the unit of something that is declared in percent."""
        if node.span in self._shown:
            return True
        match node:
            case (
                ir.SensorValue(name=name)
                | ir.DerivedValue(name=name)
                | ir.LocalValue(name=name)
                | ir.StateValue(name=name)
            ):
                return name in self._values
            case ir.LoopElement(name=name):
                return name in self._elements
            case ir.SentField(actuator=actuator, field_index=index):
                return self.field_in_percent(actuator, index)
            case _:
                self.enter(node)
                return any(map(self.in_percent, _parts(node)))
