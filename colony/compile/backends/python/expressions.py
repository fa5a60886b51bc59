"""The values of a `Code` as Python text: assignments for some of them, and expressions for the rest."""

from __future__ import annotations

from colony.compile.backends.python.plan import Placement, is_atom
from colony.compile.backends.python.text import (
    TRUE,
    ExpressionText,
    NumberRange,
    Precedence,
    UniqueNames,
    apply_operator,
    literal,
)
from colony.execute.code import (
    Apply,
    Code,
    Commanded,
    FrameTime,
    Literal,
    Lost,
    OldCell,
    Op,
    PythonActive,
    PythonBlind,
    PythonField,
    Restarted,
    SensorElement,
    SensorFresh,
    Sent,
    Table,
    Winner,
)
from colony.execute.operators import Operator
from colony.ir.types import Array

_MAX_DEPTH = 8
_MAX_LINE_LENGTH = 96
_MIN_SLICE_LENGTH = 4
_MAX_SUM_TERMS = 250

_STARRED = {
    Operator.SUM: "total",
    Operator.COUNT: "count",
    Operator.MIN: "minimum",
    Operator.MAX: "maximum",
    Operator.INDEX_OF_MIN: "index_of_min",
    Operator.INDEX_OF_MAX: "index_of_max",
}


class ExpressionTexts:
    """The text of every value that is used, and the statements of each slot.

    Expressions that nest too deep or are too long are broken up: parts of them are assigned to variables.
    """

    def __init__(
        self, code: Code, placement: Placement, ranges: list[NumberRange], names: UniqueNames
    ) -> None:
        self.code = code
        self.statements: dict[int, list[str]] = {}
        self._placement = placement
        self._ranges = ranges
        self._names = names
        self._sizes = {s.name: s.type.size for s in code.sensors if isinstance(s.type, Array)}
        self._texts: list[ExpressionText] = []
        for value, op in enumerate(code.ops):
            self._texts.append(self._text(value, op) if placement.uses[value] else TRUE)

    def text(self, value: int) -> ExpressionText:
        """Return a value as an expression, for a statement after the slot recorded for that use."""
        return self._texts[value]

    def _text(self, value: int, op: Op) -> ExpressionText:
        if is_atom(op):
            return self._atom(op)
        text = self._compound(value, op)
        simple = text.binding is Precedence.ATOM and text.depth == 0
        is_assigned = self._placement.named[value] and not simple
        if is_assigned or (isinstance(op, OldCell) and self._placement.named[value]):
            return self._name(value, text)
        if text.depth > _MAX_DEPTH or len(text.text) > _MAX_LINE_LENGTH:
            return self._name(value, text)
        return text

    def _name(self, value: int, text: ExpressionText) -> ExpressionText:
        name = self._names.value(value)
        statements = self.statements.setdefault(self._placement.slot[value], [])
        statements.append(self._assignment(value, name, text.text))
        return ExpressionText(name)

    def _assignment(self, value: int, name: str, text: str) -> str:
        """Return the statement that names a value."""
        return f"{name} = {text}"

    def _atom(self, op: Op) -> ExpressionText:
        names = self._names
        match op:
            case Literal(value=value):
                return literal(value)
            case SensorElement(sensor=sensor, index=index):
                name = names.sensors[sensor]
                return ExpressionText(f"{name}[{index}]" if sensor in self._sizes else name)
            case SensorFresh(sensor=sensor):
                return ExpressionText(names.fresh[sensor])
            case FrameTime():
                return ExpressionText("t")
            case Restarted():
                return ExpressionText("restarted")
            case PythonActive(module=module) if module in names.python_active:
                return ExpressionText(names.python_active[module])
            case PythonBlind(module=module) if module in names.python_active:
                return ExpressionText(names.python_blind[module])
            case PythonField(module=module, index=index) if module in names.python_active:
                return ExpressionText(f"{names.python_fields[module]}[{index}]")
            case Winner(actuator=actuator, module=module):
                return ExpressionText(f"{names.by[actuator]} == {module!r}", Precedence.COMPARISON)
            case Commanded(actuator=actuator):
                return ExpressionText(names.commanded[actuator])
            case Sent(actuator=actuator, index=index):
                return ExpressionText(names.field[actuator, index])
            case PythonActive() | PythonBlind() | PythonField() | Lost():
                raise ValueError("the code of a single client is not for this backend")
            case _:
                raise AssertionError(f"{op} is not an atom")

    def _compound(self, value: int, op: Op) -> ExpressionText:
        match op:
            case OldCell(cell=cell):
                return ExpressionText(f"self.{self._names.cells[cell]}")
            case Table(elements=elements):
                return self._table(elements)
            case Apply(operator=Operator.AND, arguments=arguments):
                already_true = self._placement.layout.true_values_at(self._placement.slot[value])
                rest = [self._texts[i] for i in arguments if i not in already_true]
                return apply_operator(Operator.AND, rest, []) if len(rest) > 1 else rest[0] if rest else TRUE
            case Apply(operator=operator, arguments=arguments):
                return self._applied(operator, arguments)
            case _:
                raise AssertionError(f"{op} is an atom")

    def _applied(self, operator: Operator, arguments: tuple[int, ...]) -> ExpressionText:
        x = [self._ranges[i] for i in arguments]
        if operator in _STARRED:
            slice_text = self._slice(arguments) if len(arguments) >= _MIN_SLICE_LENGTH else None
            if slice_text and operator in (Operator.MIN, Operator.MAX) and not any(r.nan for r in x):
                return ExpressionText(f"{operator.value}({slice_text})", Precedence.ATOM, 1)
            summed = operator in (Operator.SUM, Operator.COUNT)
            if slice_text and not summed:
                return ExpressionText(f"{_STARRED[operator]}(*{slice_text})", Precedence.ATOM, 1)
            if summed and len(arguments) > _MAX_SUM_TERMS:
                items = f"*{slice_text}" if slice_text else ", ".join(self._texts[i].text for i in arguments)
                return ExpressionText(f"{_STARRED[operator]}({items})", Precedence.ATOM, 1)
        return apply_operator(operator, [self._texts[i] for i in arguments], x)

    def _table(self, elements: tuple[int, ...]) -> ExpressionText:
        whole = self._slice(elements)
        if whole:
            return ExpressionText(whole)
        depth = 1 + max(self._texts[i].depth for i in elements)
        items = ", ".join(self._texts[i].text for i in elements)
        return ExpressionText(f"({items},)", Precedence.ATOM, depth)

    def _slice(self, elements: tuple[int, ...]) -> str | None:
        """Return the text of a slice if these are consecutive elements of one sensor, otherwise None."""
        first, last = self.code.ops[elements[0]], self.code.ops[elements[-1]]
        if not (isinstance(first, SensorElement) and isinstance(last, SensorElement)):
            return None
        sensor, start, stop = first.sensor, first.index, last.index + 1
        if sensor not in self._sizes or stop - start != len(elements):
            return None
        expected = start
        for i in elements:
            op = self.code.ops[i]
            if not isinstance(op, SensorElement) or op.sensor != sensor or op.index != expected:
                return None
            expected += 1
        name = self._names.sensors[sensor]
        return name if stop - start == self._sizes[sensor] else f"{name}[{start}:{stop}]"
