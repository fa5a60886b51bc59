"""Checking of function calls: pure functions, reductions, and functions with memory."""

from __future__ import annotations

from collections.abc import Callable

from colony.dsl import ast
from colony.dsl.check.checker import CONSTANT_HINT, Checker, percent_hint, sent_field
from colony.dsl.check.compatibility import freshness, reads_parts, unify, with_article, with_articles
from colony.dsl.check.scope import (
    ArgumentSymbol,
    AssumptionSymbol,
    BrokenSymbol,
    LetSymbol,
    PlaceholderSymbol,
    SensorSymbol,
)
from colony.ir import expression as ir
from colony.ir.program import SENT
from colony.ir.types import (
    BOOL,
    DEGREES,
    DIMENSIONLESS,
    DURATION,
    Array,
    Bool,
    Quantity,
    Scalar,
    element_type,
    type_text,
)
from colony.text.units import ANGLE, NUMBER, Dimension
from colony.text.wording import Remedy, one_line

_SPECIAL = ("window", "fresh", "value_or", "now")
_PURE = {f.value: f for f in ir.Function}
_MEMORY = {m.value: m for m in ir.MemoryFunction}
FUNCTION_NAMES = (*_PURE, *_MEMORY, *_SPECIAL)
FOREIGN_FUNCTIONS = {
    "held": "`recently(b, D)` is true until D after the last frame with b, "
    "`sustained(b, D)` once b has been true for D without a break",
    **{
        foreign: Remedy(f"write `{own}`", foreign, own)
        for own, names in {
            "mean": ("avg", "average"),
            "index_of_min": ("argmin", "index_min", "min_index"),
            "index_of_max": ("argmax", "index_max", "max_index"),
        }.items()
        for foreign in names
    },
    **dict.fromkeys(
        ("len", "length", "size"),
        "the length of an array is declared, and no function returns it; `count` takes bools",
    ),
}
"""Hints for functions that other languages have."""


def check_call(checker: Checker, node: ast.CallNode) -> ir.Expression | None:
    """Check a call of a function of the language, but not a reduction over a variable."""
    name = node.function.text
    if name in _PURE:
        return _pure(checker, node, _PURE[name])
    if name in _MEMORY:
        return _memory(checker, node, _MEMORY[name])
    special: dict[str, Callable[[Checker, ast.CallNode], ir.Expression | None]] = {
        "window": _window,
        "fresh": _fresh,
        "value_or": _value_or,
        "now": _now,
    }
    return special[name](checker, node)


def reject_named_arguments(checker: Checker, node: ast.CallNode) -> bool:
    """Report arguments by name, which functions of the language do not take."""
    if not node.named:
        return False
    name = node.function.text
    hint = f"use: {_USAGE[name]}" if name in _USAGE else "compare with `==`"
    checker.error("E203", node.named[0], f"`{name}` takes its arguments by position", hint)
    return True


def _arguments(
    checker: Checker, node: ast.CallNode, low: int, high: int | None
) -> list[ir.Expression] | None:
    """Return the typed arguments; None after reporting a wrong number of arguments or a wrong argument."""
    if not _has_arity(checker, node, low, high):
        return None
    arguments = [checker.visit(a) for a in node.arguments]
    return None if any(a is None for a in arguments) else [a for a in arguments if a is not None]


def _has_arity(checker: Checker, node: ast.CallNode, low: int, high: int | None) -> bool:
    """Report a call that has not `low` to `high` (None: any more) arguments; return True if it has."""
    count = len(node.arguments)
    if count < low or (high is not None and count > high):
        expected = str(low) if low == high else f"{low} or more" if high is None else f"{low} to {high}"
        expected, plural = "no" if high == 0 else expected, "" if expected == "1" else "s"
        usage = _USAGE.get(node.function.text)
        hint = f"use: {usage}" if usage else None
        message = f"`{node.function.text}` takes {expected} argument{plural}, found {count}"
        checker.error("E203", node, message, hint)
        return False
    return True


_USAGE = {
    "mod": "mod(x, y)",
    "clamp": "clamp(x, low, high)",
    "atan2": "atan2(y, x)",
    "angle_difference": "angle_difference(a, b)",
    "window": "window(array, center, n)",
    "fresh": "fresh(sensor)",
    "value_or": "value_or(expression, other)",
    "previous": "previous(expression, initial)",
    "recently": "recently(condition, duration)",
    "sustained": "sustained(condition, duration)",
    "latch": "latch(set, reset)",
    "captured": "captured(expression, key)",
    "every": "every(duration)",
}


# --- pure functions --------------------------------------------------------------------------------

_BOOL_REDUCTIONS = frozenset({ir.Function.COUNT, ir.Function.ANY, ir.Function.ALL})
_ARITY = {
    ir.Function.MOD: 2,
    ir.Function.CLAMP: 3,
    ir.Function.ATAN2: 2,
    ir.Function.ANGLE_DIFFERENCE: 2,
}


def _pure(checker: Checker, node: ast.CallNode, function: ir.Function) -> ir.Expression | None:
    if function in ir.REDUCTIONS:
        return _reduction(checker, node, function)
    if function in ir.INDEX_FUNCTIONS:
        return _index_of(checker, node, function)
    arity = _ARITY.get(function, 1)
    arguments = _arguments(checker, node, arity, arity)
    if arguments is None:
        return None
    elements = [element_type(a.type) for a in arguments]
    for argument, element in zip(node.arguments, elements, strict=True):
        if not isinstance(element, Quantity):
            _report_type(checker, argument, node, "a number", element)
            return None
    result = _elementwise_result(checker, node, function, [e for e in elements if isinstance(e, Quantity)])
    if result is None:
        return None
    type_ = checker.broadcast(node, result, *(a.type for a in arguments))
    if type_ is None:
        return None
    return ir.FunctionCall(type=type_, function=function, arguments=tuple(arguments), span=checker.span(node))


def _report_type(
    checker: Checker,
    argument: ast.Expression,
    node: ast.CallNode,
    wanted: str,
    found: Scalar,
    hint: str | None = None,
) -> None:
    message = f"`{node.function.text}` takes {wanted}, found {with_article(found)}"
    checker.error("E202", argument, message, hint)


def _swapped_variables(checker: Checker, argument: ast.Expression) -> str | None:
    """Return a hint if an element of a reduction stands where an angle is expected, and it has a bearing."""
    if not isinstance(argument, ast.Reference) or len(argument.path) > 1:
        return None
    loop = checker.loops.get(argument.text)
    bearings = (v for v in checker.loops.values() if isinstance(v, ir.LoopElement) and v.type == DEGREES)
    if not isinstance(loop, ir.LoopElement) or next(bearings, None) is None:
        return None
    return "the element comes first, then its bearing: `for r, a in ranges`"


def _elementwise_result(
    checker: Checker, node: ast.CallNode, function: ir.Function, elements: list[Quantity]
) -> Quantity | None:
    """Return the element type of an elementwise function after checking its dimensions."""
    match function:
        case ir.Function.SIN | ir.Function.COS | ir.Function.TAN | ir.Function.ANGLE_DIFFERENCE:
            for argument, element in zip(node.arguments, elements, strict=True):
                if element.dimension != ANGLE and not element.wildcard:
                    _report_type(
                        checker, argument, node, "an angle", element, _swapped_variables(checker, argument)
                    )
                    return None
            return DEGREES if function is ir.Function.ANGLE_DIFFERENCE else DIMENSIONLESS
        case ir.Function.ASIN | ir.Function.ACOS:
            if elements[0].dimension != NUMBER and not elements[0].wildcard:
                _report_type(checker, node.arguments[0], node, "a plain number", elements[0])
                return None
            return DEGREES
        case ir.Function.SIGN:
            return DIMENSIONLESS
        case ir.Function.SQRT:
            return _square_root(checker, node, elements[0])
        case ir.Function.ATAN2 | ir.Function.MOD | ir.Function.CLAMP:
            common = _common(checker, node, node.function.text, elements)
            return DEGREES if common is not None and function is ir.Function.ATAN2 else common
        case _:
            return elements[0]


def _common(
    checker: Checker, node: ast.SyntaxNode, function: str, elements: list[Quantity]
) -> Quantity | None:
    """Return the one type of all elements, or None after reporting that there is none."""
    common: Scalar | None = elements[0]
    for element in elements[1:]:
        common = unify(common, element) if common is not None else None
    if isinstance(common, Quantity):
        return common
    shown = with_articles(elements)
    message = f"`{function}` needs numbers of one dimension, found {shown}"
    arguments = node.arguments if isinstance(node, ast.CallNode) else ()
    checker.error("E201", node, message, percent_hint(*zip(arguments, elements, strict=False)))
    return None


def _square_root(checker: Checker, node: ast.CallNode, element: Quantity) -> Quantity | None:
    if any(exponent % 2 for exponent in element.dimension):
        message = f"the square root of a value in {type_text(element)} has no unit"
        checker.error("E201", node, message, "take the root of a product such as `a * a`")
        return None
    return Quantity(Dimension(*(exponent // 2 for exponent in element.dimension)), wildcard=element.wildcard)


def _reduction(checker: Checker, node: ast.CallNode, function: ir.Function) -> ir.Expression | None:
    arguments = _arguments(checker, node, 1, None)
    if arguments is None:
        return None
    if len(arguments) > 1 and any(isinstance(a.type, Array) for a in arguments):
        name, texts = function.value, [one_line(a.span.text) for a in arguments]
        parts = [
            f"{name}({text})" if isinstance(a.type, Array) else text
            for a, text in zip(arguments, texts, strict=True)
        ]
        hint = f"reduce each array first: `{name}({', '.join(parts)})`"
        checker.error("E211", node, f"`{name}` takes one array or several scalars", hint)
        return None
    elements = [element_type(a.type) for a in arguments]
    result = reduction_result(checker, node, node.function, function, elements)
    if result is None:
        return None
    return ir.FunctionCall(
        type=result, function=function, arguments=tuple(arguments), span=checker.span(node)
    )


def reduction_result(
    checker: Checker, node: ast.SyntaxNode, name: ast.NameNode, function: ir.Function, elements: list[Scalar]
) -> Scalar | None:
    """Return the type of a reduction of these elements."""
    if function in _BOOL_REDUCTIONS:
        for element in elements:
            if not isinstance(element, Bool):
                hint = f"compare first: `{name.text}(x > 0)`" if isinstance(element, Quantity) else None
                checker.error("E202", node, f"`{name.text}` takes bools, found {with_article(element)}", hint)
                return None
        return DIMENSIONLESS if function is ir.Function.COUNT else BOOL
    numbers = [e for e in elements if isinstance(e, Quantity)]
    if len(numbers) < len(elements):
        found = next(e for e in elements if not isinstance(e, Quantity))
        hint = "count bools with `count`" if isinstance(found, Bool) else None
        checker.error("E202", node, f"`{name.text}` takes numbers, found {with_article(found)}", hint)
        return None
    return _common(checker, node, name.text, numbers)


def _index_of(checker: Checker, node: ast.CallNode, function: ir.Function) -> ir.Expression | None:
    if not _has_arity(checker, node, 1, 1):
        return None
    array = checker.array(node.arguments[0])
    if array is None:
        return None
    if not isinstance(element_type(array.type), Quantity):
        _report_type(checker, node.arguments[0], node, "an array of numbers", element_type(array.type))
        return None
    if isinstance(array, ir.Slice | ir.Window) and not _is_part(node.arguments[0]):
        assert isinstance(array.type, Array)
        whole = tuple(range(array.type.size))  # a slice of all: its index is one of what the name stands for
        array = ir.Slice(type=array.type, array=array, indices=whole, span=array.span)
    return ir.FunctionCall(type=DIMENSIONLESS, function=function, arguments=(array,), span=checker.span(node))


def _is_part(node: ast.Expression) -> bool:
    """Return True for a slice or window as written; a parameter may stand for one."""
    return isinstance(node, ast.SliceOf) or (
        isinstance(node, ast.CallNode) and node.function.text == "window"
    )


# --- window, fresh, value_or, now ------------------------------------------------------------------


def _window(checker: Checker, node: ast.CallNode) -> ir.Expression | None:
    if not _has_arity(checker, node, 3, 3):
        return None
    array, center = checker.array(node.arguments[0]), checker.visit(node.arguments[1])
    if array is None or center is None:
        return None
    assert isinstance(array.type, Array)
    if not isinstance(center.type, Quantity) or center.type.dimension != NUMBER:
        _report_type(checker, node.arguments[1], node, "a plain number as center", element_type(center.type))
        return None
    reach = checker.whole(node.arguments[2], "the reach of a window", 0, (array.type.size - 1) // 2)
    if reach is None:
        return None
    type_ = Array(array.type.element, 2 * reach + 1)
    wraps, span = array.type.closes, checker.span(node)
    return ir.Window(type=type_, array=array, center=center, reach=reach, wraps=wraps, span=span)


def _fresh(checker: Checker, node: ast.CallNode) -> ir.Expression | None:
    argument = node.arguments[0] if len(node.arguments) == 1 else None
    if not isinstance(argument, ast.Reference):
        checker.error(
            "E203", node, "`fresh` takes the name of one sensor or derived value", "use: fresh(sonar)"
        )
        return None
    if argument.path[0] == SENT:
        sent = sent_field(checker, argument)
        if sent is None:
            return None
        return ir.Fresh(type=BOOL, name=sent.name, derived=False, span=checker.span(node))
    scope, path = checker.scope.resolve(argument.path)
    symbol = scope.value(path[0]) if len(path) == 1 else None
    if path[0] in checker.local:
        symbol = checker.local[path[0]]
    found = checker.visit(argument) if symbol is None else None  # it reports an unknown name
    match symbol:
        case SensorSymbol(sensor=sensor):
            return ir.Fresh(type=BOOL, name=sensor.name, derived=False, span=checker.span(node))
        case LetSymbol(name=name, module=None):
            return ir.Fresh(type=BOOL, name=name, derived=True, span=checker.span(node))
        case PlaceholderSymbol():
            return ir.Constant(type=BOOL, value=True, span=checker.span(node))
        case ArgumentSymbol(expression=expression):
            if checker.in_contract_or_test and reads_parts(expression):
                hint = "only sensors and file-level `let`s can be asked for"
                checker.error("E202", argument, f"`{argument.text}` stands for more than these", hint)
                return None
            return freshness(expression, checker.span(node))
        case BrokenSymbol():
            return None
        case None if isinstance(found, ir.DerivedValue):  # an input, which contracts see by its full name
            return ir.Fresh(type=BOOL, name=found.name, derived=True, span=checker.span(node))
        case _ if symbol is not None or found is not None:
            hint = "only sensors and file-level `let`s can be missing"
            checker.error(
                "E202", argument, f"`{argument.text}` is neither a sensor nor a derived value", hint
            )
            return None
        case _:
            return None


BROKEN = "broken"
"""Name of the function of an assumption, unless a function of the program has it."""


def check_broken(checker: Checker, node: ast.CallNode) -> ir.Expression | None:
    """Check `broken(NAME)`: that an assumption is known to be false."""
    argument = node.arguments[0] if len(node.arguments) == 1 and not node.named else None
    if not isinstance(argument, ast.Reference):
        message = "`broken` takes the name of one assumption"
        checker.error("E203", node, message, "use: broken(NAME), for `assume NAME: ...`")
        return None
    scope, path = checker.scope.resolve(argument.path)
    symbol = scope.value(path[0]) if len(path) == 1 and path[0] not in checker.local else None
    if isinstance(symbol, AssumptionSymbol):
        if checker.constants_only:
            checker.error("E204", node, f"`{BROKEN}` is not constant", CONSTANT_HINT)
            return None
        span = checker.span(node)
        held = held_assumption(symbol.name)
        return ir.UnaryOperation(type=BOOL, operator=ir.Unary.NOT, operand=held, span=span)
    if not isinstance(symbol, BrokenSymbol) and checker.visit(argument) is not None:
        message = f"`{argument.text}` is no assumption"
        checker.error("E202", argument, message, "only what is declared by `assume NAME: ...` can be broken")
    return None


def held_assumption(name: str) -> ir.Expression:
    """Return the condition that an assumption, by its full name, is true or missing."""
    value = ir.DerivedValue(type=BOOL, name=name)
    return ir.ValueOr(type=BOOL, expression=value, other=ir.Constant(type=BOOL, value=True))


def _value_or(checker: Checker, node: ast.CallNode) -> ir.Expression | None:
    arguments = _arguments(checker, node, 2, 2)
    if arguments is None:
        return None
    expression, other = arguments
    element = unify(element_type(expression.type), element_type(other.type))
    if element is None:
        shown = with_articles((expression.type, other.type))
        hint = percent_hint(*zip(node.arguments, (expression.type, other.type), strict=True))
        checker.error("E201", node, f"`value_or` needs two values of one type, found {shown}", hint)
        return None
    type_ = checker.broadcast(node, element, expression.type, other.type)
    if type_ is None:
        return None
    return ir.ValueOr(type=type_, expression=expression, other=other, span=checker.span(node))


def _now(checker: Checker, node: ast.CallNode) -> ir.Expression | None:
    if _arguments(checker, node, 0, 0) is None:
        return None
    return ir.Now(type=DURATION, span=checker.span(node))


# --- functions with memory -------------------------------------------------------------------------

_SIGNATURES: dict[ir.MemoryFunction, str] = {
    # v: any value, i: a value of the type of the first argument, b: bools, d: a constant duration
    ir.MemoryFunction.PREVIOUS: "vi",
    ir.MemoryFunction.CHANGED: "v",
    ir.MemoryFunction.RISING: "b",
    ir.MemoryFunction.FALLING: "b",
    ir.MemoryFunction.RECENTLY: "bd",
    ir.MemoryFunction.SUSTAINED: "bd",
    ir.MemoryFunction.ELAPSED: "b",
    ir.MemoryFunction.LATCH: "bb",
    ir.MemoryFunction.CAPTURED: "vv",
    ir.MemoryFunction.EVERY: "d",
}


def _memory(checker: Checker, node: ast.CallNode, function: ir.MemoryFunction) -> ir.Expression | None:
    if not checker.memory:
        hint = "memory functions are allowed in let, when, do, next, transitions, limits and contracts"
        checker.error("E209", node, f"`{function.value}` has memory and is not allowed here", hint)
        return None
    signature = _SIGNATURES[function]
    if not _has_arity(checker, node, len(signature), len(signature)):
        return None
    arguments: list[ir.Expression] = []
    duration_ns, valid = 0, True
    for kind, argument in zip(signature, node.arguments, strict=True):
        if kind == "d":
            duration = checker.duration_ns(argument, f"the duration of `{function.value}`")
            valid, duration_ns = valid and duration is not None, duration or 0
            continue
        found = checker.visit(argument)
        if found is not None and kind == "b" and not isinstance(element_type(found.type), Bool):
            _report_type(checker, argument, node, "a bool", element_type(found.type))
            found = None
        if found is None:
            valid = False
        else:
            arguments.append(found)
    if not valid:
        return None
    result = _memory_result(checker, node, function, arguments)
    if result is None:
        return None
    type_ = checker.broadcast(node, result, *(a.type for a in arguments))
    if type_ is None:
        return None
    return ir.MemoryCall(
        type=type_,
        function=function,
        arguments=tuple(arguments),
        cell=checker.report.new_cell(),
        duration_ns=duration_ns,
        span=checker.span(node),
    )


def _memory_result(
    checker: Checker, node: ast.CallNode, function: ir.MemoryFunction, arguments: list[ir.Expression]
) -> Scalar | None:
    match function:
        case ir.MemoryFunction.PREVIOUS:
            first, initial = (element_type(a.type) for a in arguments)
            common = unify(first, initial)
            if common is None:
                found = with_articles((first, initial))
                hint = percent_hint(*zip(node.arguments, (first, initial), strict=True))
                checker.error("E201", node, f"`previous` needs two values of one type, found {found}", hint)
            return common
        case ir.MemoryFunction.CAPTURED:
            return element_type(arguments[0].type)
        case ir.MemoryFunction.ELAPSED:
            return DURATION
        case _:
            return BOOL
