"""Plain numbers where a value in percent is meant: `battery > 20` means 2000 percent.

A percent is the plain number 0.01, so the types agree; what stands beside a value declared in percent shows
what was meant.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator
from itertools import chain

from colony.dsl import ast
from colony.dsl.check.scope import TypedParameter
from colony.ir import expression as ir
from colony.ir.program import Let, Module, Program
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
_COMPARED = frozenset({ir.Function.MIN, ir.Function.MAX, ir.Function.CLAMP})
_SAME_UNIT = _COMPARED | {ir.Function.SUM, ir.Function.MEAN, ir.Function.ABS}
_SAME_UNIT_MEMORY = frozenset({ir.MemoryFunction.PREVIOUS, ir.MemoryFunction.CAPTURED})

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


def percent_findings(program: Program, params: PlainParams) -> Iterator[Diagnostic]:
    """Yield an error for each plain number beyond 1 beside a value that is declared in percent."""
    units = _Units(program)
    if not units.declares_percent():
        return
    steps = chain.from_iterable(example.steps for example in program.tests)
    expectations = chain.from_iterable(step.expectations for step in steps)
    for root in chain(expressions(program), expectations):
        for node in ir.subexpressions(root):
            for value, numbers in _neighbors(node):
                if units.in_percent(value):
                    is_inlined = not all(_is_inside(n.span, node.span) for n in (value, *numbers))
                    origin = (Label(value.span, "given here"),) if is_inlined else ()
                    yield from _findings(_shown(value.span), numbers, params, *origin)
    for where, value in chain(_limits(program, units), _commands(program, units)):
        yield from _findings(where, (value,), params)


def _neighbors(node: ir.Expression) -> Iterator[tuple[ir.Expression, tuple[ir.Expression, ...]]]:
    """Yield each operand of a comparison, or of `value_or`, with the others: they have its unit."""
    match node:
        case ir.BinaryOperation(operator=operator, left=left, right=right) if operator in _COMPARISONS:
            yield left, (right,)
            yield right, (left,)
        case ir.Within(operand=operand, low=low, high=high):
            yield operand, (low, high)
        case ir.ValueOr(expression=expression, other=other):
            yield expression, (other,)
        case ir.Call(function=function, arguments=arguments) if function in _COMPARED:
            for value in arguments:
                yield value, tuple(other for other in arguments if other is not value)
        case _:
            pass


def argument_findings(parameter: TypedParameter, value: ir.Expression) -> Iterator[Diagnostic]:
    """Yield an error for a plain number beyond 1 that is given to a parameter or input in percent."""
    if parameter.unit == PERCENT:
        yield from _findings(f"`{parameter.name}`", (value,), ())


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
        while isinstance(node, ir.UnaryOperation):
            node = node.operand
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


def _shown(span: Span) -> str:
    return f"`{span.text}`" if len(span.text) <= 40 and "\n" not in span.text else "the other operand"


class _Units:
    """What a program declares in percent, and lets that are computed from it alone."""

    def __init__(self, program: Program) -> None:
        self.actuators = {actuator.name: actuator for actuator in program.robot.actuators}
        self._values = {sensor.name for sensor in program.robot.sensors if sensor.unit == PERCENT}
        of_modules = (m.lets for m in program.modules if isinstance(m, Module))
        for let in chain(program.derived, *of_modules):  # each after those that it reads
            if isinstance(let, Let) and self.in_percent(let.expression):
                self._values.add(let.name)

    def declares_percent(self) -> bool:
        """Return True if anything is declared in percent."""
        fields = (field for actuator in self.actuators.values() for field in actuator.fields)
        return bool(self._values) or any(field.unit == PERCENT for field in fields)

    def field_in_percent(self, actuator: str, index: int) -> bool:
        """Return True if a field of an actuator is declared in percent."""
        return self.actuators[actuator].fields[index].unit == PERCENT

    def in_percent(self, node: ir.Expression) -> bool:
        """Return True if an expression has the unit of something that is declared in percent."""
        match node:
            case ir.SensorValue(name=name) | ir.DerivedValue(name=name) | ir.LocalValue(name=name):
                return name in self._values
            case ir.SentField(actuator=actuator, field_index=index):
                return self.field_in_percent(actuator, index)
            case ir.Element(array=array) | ir.Slice(array=array) | ir.Window(array=array):
                return self.in_percent(array)
            case ir.ValueOr(expression=inner):
                return self.in_percent(inner)
            case ir.Reduce(function=function, body=body) if function in _SAME_UNIT:
                return self.in_percent(body)
            case ir.UnaryOperation(operand=operand):
                return self.in_percent(operand)
            case ir.BinaryOperation(operator=operator, left=left, right=right) if operator in _SUMS:
                return self.in_percent(left) or self.in_percent(right)
            case ir.Conditional(yes=yes, no=no):
                return self.in_percent(yes) or self.in_percent(no)
            case ir.Call(function=function, arguments=arguments) if function in _SAME_UNIT:
                return any(map(self.in_percent, arguments))
            case ir.MemoryCall(function=function, arguments=arguments) if function in _SAME_UNIT_MEMORY:
                return self.in_percent(arguments[0])
            case _:
                return False
