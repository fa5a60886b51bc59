"""The values of a `Code` as C: constants with names for some of them, and expressions for the rest."""

from __future__ import annotations

import re
from math import isinf

from colony.compile.backends.python.expressions import ExpressionTexts
from colony.compile.backends.python.plan import Placement
from colony.compile.backends.python.text import INFIX, ExpressionText, NumberRange, Precedence, UniqueNames
from colony.execute.code import (
    Apply,
    Code,
    Commanded,
    FrameTime,
    Kind,
    Literal,
    OldCell,
    Op,
    Restarted,
    SensorElement,
    SensorFresh,
    Sent,
    Table,
    Winner,
)
from colony.execute.operators import Operator

KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int "
    "long register restrict return short signed sizeof static struct switch typedef union unsigned void "
    "volatile while bool true false asm NULL NAN INFINITY".split()
)
OWN = frozenset("nearbyint int64_t uint64_t uint32_t uint8_t m f out t begun first_ns".split())
"""Names that are taken in a step and in its memory, besides keywords."""

_LEAST_LOOP = 4
"""Number of operands from which a fold is a loop over an array."""

_CALLS: dict[Operator, str] = {
    Operator.ABS: "fabs",
    Operator.SIGN: "colony_sign",
    Operator.SQRT: "colony_sqrt",
    Operator.FLOOR: "floor",
    Operator.CEIL: "ceil",
    Operator.ROUND: "nearbyint",
    Operator.SIN: "colony_sin",
    Operator.COS: "colony_cos",
    Operator.TAN: "colony_tan",
    Operator.ASIN: "colony_asin",
    Operator.ACOS: "colony_acos",
    Operator.MODULO: "colony_modulo",
    Operator.ATAN2: "colony_atan2",
    Operator.FINITE: "colony_finite",
}

_FOLDS: dict[Operator, str] = {
    Operator.MIN: "colony_least",
    Operator.MAX: "colony_greatest",
    Operator.SUM: "colony_total",
    Operator.COUNT: "colony_count",
    Operator.INDEX_OF_MIN: "colony_index_of_min",
    Operator.INDEX_OF_MAX: "colony_index_of_max",
}

_PAIRS = {Operator.MIN: "colony_min", Operator.MAX: "colony_max"}

TYPES = {Kind.NUMBER: "double", Kind.BOOL: "bool", Kind.TIME: "int64_t"}


def literal(value: float | bool | int) -> ExpressionText:
    """Return a constant."""
    if isinstance(value, bool):
        return ExpressionText("true" if value else "false")
    if isinstance(value, int):
        return ExpressionText(f"INT64_C({value})")
    if value != value:
        return ExpressionText("(double)NAN", Precedence.SIGN)
    if isinf(value):
        return ExpressionText(f"{'-' if value < 0 else ''}(double)INFINITY", Precedence.SIGN)
    text = repr(value)
    return ExpressionText(text, Precedence.SIGN if text.startswith("-") else Precedence.ATOM)


def identifier(name: str) -> str:
    """Return a name as an identifier of C."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return word if re.match(r"[A-Za-z]", word) and word not in KEYWORDS else f"c_{word}"


class CTexts(ExpressionTexts):
    """The C text of every value that is used, and the statements of each slot."""

    def __init__(
        self,
        code: Code,
        placement: Placement,
        ranges: list[NumberRange],
        names: UniqueNames,
        modules: dict[str, str],
    ) -> None:
        """Take the names of variables, and the constant of each module."""
        self._modules = modules
        super().__init__(code, placement, ranges, names)

    def _assignment(self, value: int, name: str, text: str) -> str:
        kind = self.code.kinds[value]
        if kind is Kind.TABLE:
            op = self.code.ops[value]
            assert isinstance(op, Table)
            of = f"{TYPES[self.code.kinds[op.elements[0]]]} *const"
        else:
            of = TYPES[kind]
        return f"const {of} {name} = {text};"

    def _atom(self, op: Op) -> ExpressionText:
        names = self._names
        match op:
            case Literal(value=value):
                return literal(value)
            case SensorElement() | SensorFresh() | FrameTime() | Restarted() | Sent() | Commanded():
                return super()._atom(op)
            case Winner(actuator=actuator, module=module):
                if module not in self._modules:
                    return literal(False)
                return ExpressionText(
                    f"{names.by[actuator]} == {self._modules[module]}", Precedence.COMPARISON
                )
            case _:
                raise ValueError(
                    "modules in Python, and the code of a single client, are not for this backend"
                )

    def _compound(self, value: int, op: Op) -> ExpressionText:
        match op:
            case OldCell(cell=cell):
                return ExpressionText(f"m->{self._names.cells[cell]}")
            case Apply(operator=Operator.AND, arguments=arguments):
                already_true = self._placement.layout.true_values_at(self._placement.slot[value])
                rest = tuple(i for i in arguments if i not in already_true)
                return self._applied(Operator.AND, rest) if rest else literal(True)
            case _:
                return super()._compound(value, op)

    def _applied(self, operator: Operator, arguments: tuple[int, ...]) -> ExpressionText:
        if operator in (Operator.PICK_NUMBER, Operator.PICK_BOOL):
            table = self.code.ops[arguments[0]]
            assert isinstance(table, Table)
            whole, index = (self._texts[i] for i in arguments)
            call = f"colony_{operator.value}({whole.text}, {len(table.elements)}, {index.text})"
            return ExpressionText(call, Precedence.ATOM, 1 + max(whole.depth, index.depth))
        if operator in _FOLDS and (len(arguments) >= _LEAST_LOOP or operator not in (*_PAIRS, Operator.SUM)):
            whole = self._table(arguments)
            call = f"{_FOLDS[operator]}({whole.text}, {len(arguments)})"
            return ExpressionText(call, Precedence.ATOM, 1 + whole.depth)
        o = [self._texts[i] for i in arguments]
        return ExpressionText(*_applied(operator, o), 1 + max(p.depth for p in o))

    def _table(self, elements: tuple[int, ...]) -> ExpressionText:
        part = self._slice(elements)
        if part is not None:
            return ExpressionText(part)
        items = ", ".join(self._texts[i].text for i in elements)
        text = f"(const {TYPES[self.code.kinds[elements[0]]]}[]){{{items}}}"
        return ExpressionText(text, Precedence.SIGN, 1 + max(self._texts[i].depth for i in elements))

    def _slice(self, elements: tuple[int, ...]) -> str | None:
        part = super()._slice(elements)
        name, bracket, rest = (part or "").partition("[")
        return f"&{name}[{rest.partition(':')[0]}]" if bracket else part


def _applied(operator: Operator, o: list[ExpressionText]) -> tuple[str, Precedence]:
    match operator:
        case Operator.NOT:
            return f"!{o[0].inside(Precedence.SIGN)}", Precedence.SIGN
        case Operator.AND:
            return _infix("&&", Precedence.AND, o) if len(o) > 1 else (o[0].text, o[0].binding)
        case Operator.OR:
            return " || ".join(p.inside(Precedence.NOT) for p in o), Precedence.OR
        case Operator.SELECT:
            condition, yes = o[0].inside(Precedence.OR), o[1].inside(Precedence.OR)
            return f"{condition} ? {yes} : {o[2].inside(Precedence.CONDITIONAL)}", Precedence.CONDITIONAL
        case Operator.NEGATE:
            return f"-{o[0].inside(Precedence.ATOM)}", Precedence.SIGN
        case Operator.SECONDS:
            return f"(double){o[0].inside(Precedence.SIGN)} / 1e9", Precedence.PRODUCT
        case Operator.SUM:
            return _infix("+", Precedence.SUM, o) if len(o) > 1 else (o[0].text, o[0].binding)
        case Operator.MIN | Operator.MAX:
            text = o[0].text
            for p in o[1:]:
                text = f"{_PAIRS[operator]}({text}, {p.text})"
            return text, Precedence.ATOM if len(o) > 1 else o[0].binding
        case _ if operator in INFIX:
            return _infix(*INFIX[operator], o)
        case _:
            return f"{_CALLS[operator]}({', '.join(p.text for p in o)})", Precedence.ATOM


def _infix(sign: str, binding: Precedence, o: list[ExpressionText]) -> tuple[str, Precedence]:
    first = o[0].inside(binding + 1 if binding is Precedence.COMPARISON else binding)
    return f" {sign} ".join([first, *(p.inside(binding + 1) for p in o[1:])]), binding
