"""Functions: `let name(parameter, ...) = body`, inlined where they are called.

A body is checked where it is declared, with parameters that have only types, so that its errors show once.
Each call checks its arguments once, in the caller's context, and then the body again: in the scope of its
declaration, with parameters that stand for the arguments. So the program has no functions, and memory belongs
to the place of the call. `program_size` counts what this adds, and refuses calls that add too much.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import assert_never

from colony.dsl import ast
from colony.dsl.check.calls import (
    BROKEN,
    FOREIGN_FUNCTIONS,
    FUNCTION_NAMES,
    check_broken,
    check_call,
    reject_named_arguments,
)
from colony.dsl.check.checker import CONSTANT_HINT, Checker, reject_private_name
from colony.dsl.check.compatibility import argument_symbol, placeholder, with_article, without_wildcard_type
from colony.dsl.check.references import kind_of_part
from colony.dsl.check.robot import argument_hint, check_parameter, takes, what_it_takes
from colony.dsl.check.scope import (
    MAX_NODES,
    ArgumentSymbol,
    BrokenSymbol,
    CheckReport,
    EnumSymbol,
    Excess,
    FileScope,
    FunctionSymbol,
    ParamSymbol,
    PlaceholderSymbol,
    TypedParameter,
    ValueSymbol,
    span_of,
)
from colony.ir import expression as ir
from colony.ir.types import Type
from colony.text.diagnostics import Diagnostic, Label, has_errors
from colony.text.wording import quoted

_CALLS_SHOWN = 10
"""Maximum number of calls shown with an error in the body of a function."""


def check_any_call(checker: Checker, node: ast.CallNode) -> ir.Expression | None:
    """Check a call of a function of the language, or of one that is declared."""
    name = node.function.text
    if name in FUNCTION_NAMES:
        return None if reject_named_arguments(checker, node) else check_call(checker, node)
    if name == BROKEN and BROKEN not in checker.local and checker.scope.value(BROKEN) is None:
        return check_broken(checker, node)
    symbol = _function_called(checker, node)
    if not isinstance(symbol, FunctionSymbol):
        checker.report.size.is_broken = True
        for argument in (*node.arguments, *(n.value for n in node.named)):
            checker.visit(argument)
        return None
    if checker.constants_only:
        checker.error(
            "E204", node, f"a call is not constant: `{name}` is computed in each frame", CONSTANT_HINT
        )
        return None
    arguments = _arguments(checker, node, symbol)
    if arguments is None:
        checker.report.size.nodes += symbol.nodes
        return None
    return _inlined(checker, node, symbol, arguments)


def _function_called(checker: Checker, node: ast.CallNode) -> FunctionSymbol | BrokenSymbol | None:
    """Return the function that a call names, or None after reporting an error."""
    name, path = node.function, tuple(node.function.text.split("."))
    symbol: ValueSymbol | None = None
    scope, rest = checker.scope, path
    if path[0] in checker.loops:
        checker.error("E106", name, f"`{name.text}` is the variable of a reduction, not a function")
        return None
    if len(path) == 1:
        symbol = checker.local.get(path[0])
    if symbol is None and path[0] not in checker.local:
        scope, rest = checker.scope.resolve(path)
        symbol = scope.value(rest[0])
    if len(rest) == 1 and isinstance(symbol, FunctionSymbol):
        return symbol
    if isinstance(symbol, BrokenSymbol):
        return symbol
    if symbol is not None:
        kind = {EnumSymbol: "an enum", ParamSymbol: "a constant"}.get(type(symbol), "a value")
        hint = "leave the parentheses out" if len(rest) == 1 and not node.arguments else None
        checker.error("E106", name, f"`{name.text}` is {kind}, not a function", hint)
        return None
    _report_unknown(checker, name, scope, rest)
    return None


def _report_unknown(checker: Checker, name: ast.NameNode, scope: FileScope, rest: tuple[str, ...]) -> None:
    part = scope.network_symbol(rest[0])
    if isinstance(part, BrokenSymbol) or reject_private_name(checker, name, scope, rest[0]):
        return
    if part is not None:
        what = kind_of_part(part)
        hint = "a function of a module can be called only inside it" if len(rest) > 1 else None
        checker.error("E106", name, f"`{rest[0]}` is {what}, not a function", hint)
        return
    if len(rest) == 1 and (rest[0] in scope.visible_values or rest[0] in checker.module_names):
        if checker.constants_only:
            checker.error("E204", name, f"`{name.text}` is not constant", CONSTANT_HINT)
            return
        hint = "declare it above the line that calls it; a function cannot call itself"
        checker.error("E105", name, f"`{name.text}` is used before it is declared", hint)
        return
    known = [*FUNCTION_NAMES, *checker.local, *scope.visible_values]
    suggestion = FOREIGN_FUNCTIONS.get(name.text) or checker.report.suggest(rest[-1], known)
    checker.error("E107", name, f"unknown function `{name.text}`", suggestion)


# --- declarations ----------------------------------------------------------------------------------


def declare_function(
    checker: Checker, node: ast.FunctionDecl, local: Mapping[str, ValueSymbol]
) -> FunctionSymbol | BrokenSymbol:
    """Check a function where it is declared; `local` are the names of its module above it."""
    report, before = checker.report, len(checker.report.diagnostics)
    if node.name.text in FUNCTION_NAMES:
        message = f"`{node.name.text}` is a function of the language"
        checker.error("E109", node.name, message, "choose another name")
    parameters = _parameters(checker, node)
    if parameters is None or has_errors(report.diagnostics[before:]):
        return BrokenSymbol()
    function = FunctionSymbol(
        declaration=node,
        parameters=parameters,
        scope=checker.scope,
        local=dict(local),
        module_names=checker.module_names,
    )
    cells, size = report.cells, report.size
    nodes = size.begin_declaration()
    inner = replace(checker, local={**local, **_placeholders(parameters)}, in_function=True)
    found = inner.check(node.value)
    depth, added = size.deepest, size.nodes - nodes
    report.cells = cells
    if size.is_broken or has_errors(report.diagnostics[before:]):
        return BrokenSymbol()
    result = None if found is None else without_wildcard_type(found).type
    return replace(function, result=result, nodes=added, depth=depth)


def _parameters(checker: Checker, node: ast.FunctionDecl) -> tuple[TypedParameter, ...] | None:
    names: dict[str, ast.NameNode] = {}
    parameters: list[TypedParameter] = []
    for parameter in node.parameters:
        first = names.setdefault(parameter.name.text, parameter.name)
        if first is not parameter.name:
            message = f"parameter `{first.text}` is declared twice"
            checker.error("E102", parameter.name, message, None, checker.label(first))
        typed = check_parameter(checker, parameter)
        if typed is not None and parameter.initial is not None:
            default = _default(checker, parameter, typed)
            typed = None if default is None else replace(typed, default=default)
        parameters += [typed] if typed else []
    return tuple(parameters) if len(parameters) == len(node.parameters) else None


def _default(checker: Checker, node: ast.ParameterNode, typed: TypedParameter) -> ir.Constant | None:
    """Return the default of a parameter, or None after reporting an error."""
    assert node.initial is not None
    if typed.is_array:
        message = f"the array `{node.name.text}` cannot have a default: there are no constant arrays"
        checker.error("E204", node.initial, message, "leave it out")
        return None
    return checker.constant(node.initial, typed.element, f"the default of `{node.name.text}`")


def _placeholders(parameters: tuple[TypedParameter, ...]) -> dict[str, ValueSymbol]:
    """Return what parameters are in the declaration: the bearings of an array are only those of arguments."""
    return {p.name: BrokenSymbol() if p.is_array else PlaceholderSymbol(type=p.element) for p in parameters}


# --- calls -----------------------------------------------------------------------------------------


def _arguments(
    checker: Checker, node: ast.CallNode, function: FunctionSymbol
) -> dict[str, ArgumentSymbol] | None:
    """Check the arguments of a call; return them by the names of the parameters."""
    given = _given(checker, node, function)
    arguments: dict[str, ArgumentSymbol] = {}
    for parameter in function.parameters:
        value = given.get(parameter.name)
        if value is None:
            if parameter.default is not None:
                arguments[parameter.name] = argument_symbol(parameter.default, parameter.element, 1)
            continue
        before = checker.report.size.nodes
        found = checker.visit(value)
        nodes = checker.report.size.nodes - before
        if found is not None and _fits(checker, node, value, parameter, found.type):
            arguments[parameter.name] = argument_symbol(found, parameter.element, nodes)
    return arguments if len(arguments) == len(function.parameters) else None


def _given(checker: Checker, node: ast.CallNode, function: FunctionSymbol) -> dict[str, ast.Expression]:
    """Return the arguments as written, by the names of the parameters, and report wrong ones."""
    names = [p.name for p in function.parameters]
    needed = [p.name for p in function.parameters if p.default is None]
    hint = f"use: {_usage(node.function.text, function)}"
    count = len(node.arguments)
    for extra in node.arguments[len(names) :]:
        checker.visit(extra)
    if count > len(names):
        most = f"{len(names)} argument{'' if len(names) == 1 else 's'}" if names else "no arguments"
        checker.error("E203", node, f"`{node.function.text}` takes {most}, found {count}", hint)
    given = dict(zip(names, node.arguments, strict=False))
    for argument in node.named:
        name = argument.name.text
        if name not in names:
            similar = checker.report.suggest(name, names) or hint
            message = f"`{node.function.text}` has no parameter `{name}`"
            checker.error("E203", argument.name, message, similar)
            checker.visit(argument.value)
        elif name in given:
            checker.error("E203", argument.name, f"parameter `{name}` is given twice")
            checker.visit(argument.value)
        else:
            given[name] = argument.value
    late = [a for a in node.arguments if node.named and a.start > node.named[0].start]
    if late:
        message = "an argument without a name stands after one with a name"
        checker.error("E203", late[0], message, hint)
    missing = [name for name in needed if name not in given]
    if missing:
        checker.error("E203", node, f"`{node.function.text}` needs {quoted(missing)}", hint)
    return given


def _usage(name: str, function: FunctionSymbol) -> str:
    shown = [p.name if p.default is None else f"{p.name} = ..." for p in function.parameters]
    return f"{name}({', '.join(shown)})"


def _fits(
    checker: Checker, node: ast.CallNode, value: ast.Expression, parameter: TypedParameter, found: Type
) -> bool:
    """Report an argument whose type is not that of its parameter."""
    if takes(parameter, found):
        return True
    what = f"parameter `{parameter.name}` of `{node.function.text}` takes {what_it_takes(parameter)}"
    hint = argument_hint(value, parameter, found)
    checker.error("E202", value, f"{what}, found {with_article(found)}", hint)
    return False


def _inlined(
    checker: Checker, node: ast.CallNode, function: FunctionSymbol, arguments: dict[str, ArgumentSymbol]
) -> ir.Expression | None:
    """Return the body of a function with these arguments, or None after reporting an error."""
    size, is_outermost = checker.report.size, not checker.in_call
    if is_outermost and not size.begin_outermost_call(in_declaration=checker.in_function):
        return None
    found: ir.Expression | None = None
    if size.admits(function.nodes, function.depth):
        if is_outermost and size.count_unchecked(function.nodes, function.depth):
            return None if function.result is None else placeholder(function.result, checker.span(node))
        before = len(checker.report.diagnostics)
        found = _body_checker(checker, function, arguments).visit(function.declaration.value)
        _show_call(checker.report, before, Label(span_of(checker.scope, node), "called here"))
    if is_outermost:
        _report_excess(checker, node, size.end_outermost_call())
    if found is None or size.excess is not None:
        return None
    return replace(without_wildcard_type(found), span=checker.span(node))


def _body_checker(
    checker: Checker, function: FunctionSymbol, arguments: dict[str, ArgumentSymbol]
) -> Checker:
    taken = checker.taken_names.union(*(a.loops for a in arguments.values()))
    return replace(
        checker,
        scope=function.scope,
        local={**function.local, **arguments},
        module_names=function.module_names,
        loops={},
        taken_loops=taken,
        in_call=True,
    )


def _show_call(report: CheckReport, before: int, call: Label) -> None:
    """Add the call to the errors that were found in its body, and drop those that are known already."""
    found = report.diagnostics[before:]
    if found:
        unique = {_identity(d): d for d in reversed(found)}
        for known in report.diagnostics[:before]:
            unique.pop(_identity(known), None)
        report.diagnostics[before:] = [
            replace(d, labels=(*d.labels, call)) if len(d.labels) < _CALLS_SHOWN else d
            for d in reversed(unique.values())
        ]


def _identity(d: Diagnostic) -> tuple[object, ...]:
    return id(d.span.source), d.span.start, d.code, d.message


def _report_excess(checker: Checker, node: ast.CallNode, excess: Excess | None) -> None:
    """Report the limit that an outermost call exceeds, if any."""
    match excess:
        case Excess.DEPTH:
            what = f"the expression nests more than {ir.NESTING_LIMIT} levels deep"
            hint = "name parts of it with `let`"
            checker.error("E004", node, f"with the functions called here, {what}", hint)
        case Excess.SIZE:
            what = f"the program has more than {MAX_NODES:,} parts of expressions"
            hint = "name what is computed often with `let`"
            checker.error("E012", node, f"with the functions called here, {what}", hint)
        case None:
            pass
        case _:
            assert_never(excess)
