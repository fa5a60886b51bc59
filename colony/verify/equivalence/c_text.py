"""Generated C as the Python that it stands for, for the proof of its guards.

pycparser reads the text. Each statement becomes the Python statement that the reader of generated Python
knows: `do { ... } while (false)` becomes a loop that is left, `out->broken[i] = e` the record of a breach. A
function that fills a variable through a pointer becomes an assignment. Whatever else the text has, such as a
macro, a second variable of one name, or a call of an unknown function, is refused.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from typing import Any

from colony.compile.backends.c.generate import CText, definitions, generate_c, preprocessor_lines
from colony.compile.guards import ClientList
from colony.compile.lower.lower import lower
from colony.ir.program import Program
from colony.verify.equivalence.forms import Form, TimerClasses, with_activities
from colony.verify.equivalence.json_text import EmittedFormError
from colony.verify.equivalence.python_text import Functions, read_functions

_TYPEDEFS = (
    "typedef long int64_t; typedef unsigned long uint64_t; typedef unsigned char uint8_t; "
    "typedef _Bool bool;\n"
)
_COMMENT = re.compile(r'("[^"\n]*")|/\*.*?\*/', re.DOTALL)

_FILLING = frozenset(
    f"colony_{name}" for name in ("number", "numbers", "member", "members", "bool", "bools", "bounded")
)
"""Functions that fill the variable that their first argument points to."""

_MATH = frozenset(("fabs", "floor", "ceil", "nearbyint"))

_OPERATORS: Mapping[str, type[ast.operator]] = {"+": ast.Add, "-": ast.Sub, "*": ast.Mult, "/": ast.Div}
_COMPARISONS: Mapping[str, type[ast.cmpop]] = {
    "<": ast.Lt,
    "<=": ast.LtE,
    ">": ast.Gt,
    ">=": ast.GtE,
    "==": ast.Eq,
    "!=": ast.NotEq,
}
_JOINED: Mapping[str, type[ast.boolop]] = {"&&": ast.And, "||": ast.Or}


class CReader:
    """A reader of a program in C and of the same program with a contract for each activity."""

    def __init__(self, program: Program, clients: ClientList, text: CText, name: str) -> None:
        """Read both texts.

        Raises:
            EmittedFormError: the text is not what the compiler generates.
        """
        self._program, self._name = program, name
        self._functions = c_functions(text)
        self._observed = c_functions(generate_c(lower(with_activities(program), clients), text.name))

    def form(self, timer_classes: TimerClasses) -> Form:
        """Return the form that the text describes."""
        return read_functions(self._program, self._functions, self._observed, self._name, timer_classes)


def c_functions(text: CText) -> Functions:
    """Return the functions of a program in C as Python.

    Raises:
        EmittedFormError: the text is not what the compiler generates.
    """
    from pycparser import CParser

    for part, expected in zip((text.header, text.source), preprocessor_lines(text.name), strict=True):
        found = [line for line in part.splitlines() if line.lstrip().startswith(("#", "%:"))]
        if found != expected or "\\" in part or "??" in part:
            raise EmittedFormError("other lines for the preprocessor", "those that are generated")
    plain = re.sub(r"^#.*", "", text.header + text.source, flags=re.MULTILINE)
    try:
        unit = CParser().parse(_TYPEDEFS + _COMMENT.sub(lambda m: m[1] or " ", plain))
    except Exception as problem:  # the parser's errors have no common class
        raise EmittedFormError(f"{type(problem).__name__}: {problem}", "C") from None
    try:
        return _Translation(unit, text).functions()
    except (LookupError, ValueError, AttributeError, TypeError) as problem:
        raise EmittedFormError(f"{type(problem).__name__}: {problem}", "generated C") from None


class _Translation:
    """The translation of a file. Mutable: collects the names declared in a function."""

    def __init__(self, unit: Any, text: CText) -> None:
        from pycparser import c_ast

        self._c, self._prefix, self._source = c_ast, text.name, text.source
        self._declared: set[str] = set()
        self._tables: dict[str, list[str]] = {}
        self._bodies: dict[str, Any] = {}
        self._actuators = 0
        numbers: dict[str, int] = {}
        for node in unit.ext:
            match node:
                case c_ast.FuncDef(decl=decl, body=body):
                    self._define(decl.name, body)
                case c_ast.Decl(name=str() as table, init=c_ast.InitList(exprs=items)):
                    if table in self._tables:
                        raise EmittedFormError(f"the table {table} twice", "it once")
                    self._tables[table] = [item.value[1:-1] for item in items]
                case c_ast.Decl(type=c_ast.Enum(name=enum, values=values)) if enum == f"{text.name}_module":
                    numbers = {x.name: int(x.value.value) for x in values.enumerators}
                case _:
                    pass
        modules = self._tables.get(f"{text.name}_modules", [])
        if any(not 0 <= number < len(modules) for number in numbers.values()):
            raise EmittedFormError("a module without a name", "a name for each")
        self._modules = {constant: modules[number] or None for constant, number in numbers.items()}

    def _define(self, name: str, body: Any) -> None:
        if name in self._bodies:
            raise EmittedFormError(f"the function {name} twice", "it once")
        own = (f"{self._prefix}_{of}" for of in ("init", "restart", "step"))
        if name not in own and definitions().get(name, "\0") not in self._source:
            raise EmittedFormError(f"another {name}", "the function of this name that is generated")
        self._bodies[name] = body

    def functions(self) -> Functions:
        functions = {}
        for name, of in (("__init__", "init"), ("step", "step")):
            body = self._bodies.get(f"{self._prefix}_{of}")
            if body is None:
                raise EmittedFormError(f"no function {self._prefix}_{of}", "one")
            self._declared.clear()
            statements = [*self._block(body), ast.Return()]
            arguments = ast.arguments(posonlyargs=[], args=[], kwonlyargs=[], kw_defaults=[], defaults=[])
            function = ast.FunctionDef(name=name, args=arguments, body=statements, decorator_list=[])
            functions[name] = ast.fix_missing_locations(function)
        return functions

    # --- statements ------------------------------------------------------------------------------

    def _block(self, node: Any) -> list[ast.stmt]:
        items = node.block_items or [] if isinstance(node, self._c.Compound) else [node]
        return [statement for item in items for statement in self._located(item)]

    def _located(self, node: Any) -> Iterator[ast.stmt]:
        line = node.coord.line if node.coord is not None else 0
        for statement in self._statement(node):
            statement.lineno, statement.col_offset = line, 0
            yield statement

    def _statement(self, node: Any) -> Iterator[ast.stmt]:
        c = self._c
        match node:
            case c.Decl(name=str() as name, init=init):
                if name in self._declared or name in self._modules:
                    raise EmittedFormError(f"{name} declared twice", "a name for each variable")
                self._declared.add(name)
                if init is not None:
                    yield from self._assigned(ast.Name(name), init)
            case c.Assignment(op="=", lvalue=target, rvalue=value):
                yield from self._assignment(target, value)
            case c.Cast(expr=c.FuncCall() as call) | (c.FuncCall() as call):
                yield from self._assigned(ast.Name("unused"), call)
            case c.If(cond=test, iftrue=body, iffalse=orelse):
                otherwise = [] if orelse is None else self._block(orelse)
                yield ast.If(self._value(test), self._block(body), otherwise)
            case c.DoWhile(cond=c.ID(name="false"), stmt=body):
                statements = self._block(body)
                if not statements or not isinstance(statements[-1], ast.Break):
                    statements.append(ast.Break())
                yield ast.While(ast.Constant(True), statements, [])
            case c.Break():
                yield ast.Break()
            case _:
                raise EmittedFormError(f"a statement of the kind {type(node).__name__}", "none of this kind")

    def _assignment(self, target: Any, value: Any) -> Iterator[ast.stmt]:
        path = self._path(target)
        match path:
            case [name] if name in self._declared:
                yield from self._assigned(ast.Name(name), value)
            case ["m", *members]:
                yield from self._assigned(ast.Attribute(ast.Name("self"), ".".join(members)), value)
            case ["out", _, "by"]:
                names = self._tables.get(f"{self._prefix}_actuators", [])
                if self._actuators >= len(names):
                    raise EmittedFormError("a decision too many", "one for each actuator")
                by = self._value(value)
                decided = [ast.Constant(names[self._actuators]), by, ast.Constant(None), ast.Constant(None)]
                self._actuators += 1
                yield ast.Assign([ast.Name(" ".join(path))], ast.Tuple(decided))
            case ["out", "broken", index]:
                name = self._tables.get(f"{self._prefix}_contracts", [])[int(index)]
                record = ast.AugAssign(ast.Name("breaches"), ast.Add(), ast.Tuple([ast.Constant(name)]))
                yield ast.If(self._value(value), [record], [])
            case ["out", *_]:
                yield from self._assigned(ast.Name(" ".join(path)), value)
            case _:
                raise EmittedFormError(f"an assignment to {'.'.join(path)}", "a variable or member")

    def _assigned(self, target: ast.expr, value: Any) -> Iterator[ast.stmt]:
        c = self._c
        match value:
            case c.FuncCall(name=c.ID(name=function), args=c.ExprList(exprs=[first, *rest])) if (
                function in _FILLING
            ):
                filled = first.expr if isinstance(first, c.UnaryOp) and first.op == "&" else first
                if not isinstance(filled, c.ID) or filled.name not in self._declared:
                    raise EmittedFormError(f"{function} of something else", "a variable to fill")
                arguments = [self._value(filled), *map(self._value, rest)]
                yield ast.Assign([ast.Name(f"{function} of")], ast.Tuple(arguments))
                yield ast.Assign(
                    [ast.Name(filled.name)], ast.Call(ast.Name(function), [ast.Name(f"{function} of")], [])
                )
                yield ast.Assign(
                    [target], ast.Call(ast.Name(f"found by {function}"), [ast.Name(f"{function} of")], [])
                )
            case _:
                yield ast.Assign([target], self._value(value))

    def _path(self, node: Any) -> list[str]:
        """Return a variable, or a member or element of one, as a list of names."""
        c = self._c
        match node:
            case c.ID(name=name):
                return [name]
            case c.StructRef(name=of, field=c.ID(name=member)):
                return [*self._path(of), member]
            case c.ArrayRef(name=of, subscript=c.Constant(type="int", value=index)):
                return [*self._path(of), index]
            case _:
                raise EmittedFormError(f"an assignment to a {type(node).__name__}", "a variable or member")

    # --- expressions -----------------------------------------------------------------------------

    def _value(self, node: Any) -> ast.expr:
        c = self._c
        match node:
            case c.ID(name="true" | "false" as name):
                return ast.Constant(name == "true")
            case c.ID(name=name):
                return ast.Constant(self._modules[name]) if name in self._modules else ast.Name(name)
            case c.Constant(type="int", value=value):
                return ast.Constant(int(value, 10))
            case c.Constant(type="double", value=value):
                return ast.Constant(float(value))
            case c.StructRef():
                path = self._path(node)
                if path[0] == "m":
                    return ast.Attribute(ast.Name("self"), ".".join(path[1:]))
                return ast.Name(" ".join(path))
            case c.FuncCall():
                return self._call(node)
            case c.ArrayRef(name=of, subscript=index):
                return ast.Subscript(self._value(of), self._value(index))
            case c.CompoundLiteral(init=c.InitList(exprs=items)):
                return ast.Tuple([self._value(item) for item in items])
            case _:
                return self._operation(node)

    def _operation(self, node: Any) -> ast.expr:
        c = self._c
        match node:
            case c.BinaryOp(op="&&" | "||" as op):
                return ast.BoolOp(_JOINED[op](), [self._value(part) for part in _flat(node, op)])
            case c.BinaryOp(op=op, left=left, right=right) if op in _COMPARISONS:
                return ast.Compare(self._value(left), [_COMPARISONS[op]()], [self._value(right)])
            case c.BinaryOp(op=op, left=left, right=right) if op in _OPERATORS:
                return ast.BinOp(self._value(left), _OPERATORS[op](), self._value(right))
            case c.TernaryOp(cond=test, iftrue=yes, iffalse=no):
                return ast.IfExp(self._value(test), self._value(yes), self._value(no))
            case c.UnaryOp(op="!", expr=expr):
                return ast.UnaryOp(ast.Not(), self._value(expr))
            case c.UnaryOp(op="-" | "&" as op, expr=expr):
                return ast.Call(ast.Name(f"unary {op}"), [self._value(expr)], [])
            case c.Cast(expr=expr):
                return ast.Call(ast.Name("double"), [self._value(expr)], [])
            case _:
                raise EmittedFormError(
                    f"an expression of the kind {type(node).__name__}", "none of this kind"
                )

    def _call(self, node: Any) -> ast.expr:
        c = self._c
        match node:
            case c.FuncCall(
                name=c.ID(name="INT64_C"), args=c.ExprList(exprs=[c.Constant(type="int", value=n)])
            ):
                return ast.Constant(int(n, 10))
            case c.FuncCall(name=c.ID(name=function), args=c.ExprList(exprs=arguments)) if (
                function in _MATH or (function in definitions() and function not in _FILLING)
            ):
                return ast.Call(ast.Name(function), [self._value(x) for x in arguments], [])
            case _:
                raise EmittedFormError("a call of an unknown function", "those that are generated")


def _flat(node: Any, op: str) -> list[Any]:
    """Return the operands of a chain of one operator, from the left, without recursion."""
    operands = []
    while getattr(node, "op", None) == op and hasattr(node, "left"):
        operands.append(node.right)
        node = node.left
    return [node, *reversed(operands)]
