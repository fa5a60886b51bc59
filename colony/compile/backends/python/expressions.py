"""The values of a Code as text: statements that name some of them, and expressions for the rest."""

from __future__ import annotations

from colony.compile.backends.python.names import Names
from colony.compile.backends.python.placement import Placement, is_atom
from colony.compile.backends.python.ranges import Range
from colony.compile.backends.python.text import TRUE, Binding, Text, applied, literal
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
    PythonField,
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


class Expressions:
    """The text of every value that is used, and the statements of each slot.

    Expressions that nest too deep or grow too long are broken up by naming parts of them.
    """

    def __init__(self, code: Code, placement: Placement, known: list[Range], names: Names) -> None:
        self.code = code
        self.statements: dict[int, list[str]] = {}
        self._placement = placement
        self._ranges = known
        self._names = names
        self._sizes = {s.name: s.type.size for s in code.sensors if isinstance(s.type, Array)}
        self._texts: list[Text] = []
        for at, op in enumerate(code.ops):
            self._texts.append(self._text(at, op) if placement.uses[at] else TRUE)

    def text(self, value: int) -> Text:
        """Return a value as an expression, for a statement after the slot that was recorded as its use."""
        return self._texts[value]

    def _text(self, at: int, op: Op) -> Text:
        if is_atom(op):
            return self._atom(op)
        text = self._compound(at, op)
        simple = text.binding is Binding.ATOM and text.depth == 0
        must = self._placement.named[at] and not simple
        if must or (isinstance(op, OldCell) and self._placement.named[at]):
            return self._name(at, text)
        if text.depth > _MAX_DEPTH or len(text.text) > _MAX_LINE_LENGTH:
            return self._name(at, text)
        return text

    def _name(self, at: int, text: Text) -> Text:
        name = self._names.value(at)
        statements = self.statements.setdefault(self._placement.slot[at], [])
        statements.append(f"{name} = {text.text}")
        return Text(name)

    def _atom(self, op: Op) -> Text:
        names = self._names
        match op:
            case Literal(value=value):
                return literal(value)
            case SensorElement(sensor=sensor, index=index):
                name = names.sensors[sensor]
                return Text(f"{name}[{index}]" if sensor in self._sizes else name)
            case SensorFresh(sensor=sensor):
                return Text(names.fresh[sensor])
            case FrameTime():
                return Text("t")
            case PythonActive(module=module) if module in names.python_active:
                return Text(names.python_active[module])
            case PythonField(module=module, index=index) if module in names.python_active:
                return Text(f"{names.python_fields[module]}[{index}]")
            case Winner(actuator=actuator, module=module):
                return Text(f"{names.by[actuator]} == {module!r}", Binding.COMPARISON)
            case Commanded(actuator=actuator):
                return Text(names.commanded[actuator])
            case Sent(actuator=actuator, index=index):
                return Text(names.field[actuator, index])
            case PythonActive() | PythonField() | Lost():
                raise ValueError("the code of a single client is not for this backend")
            case _:
                raise AssertionError(f"{op} is no atom")

    def _compound(self, at: int, op: Op) -> Text:
        match op:
            case OldCell(cell=cell):
                return Text(f"self.{self._names.cells[cell]}")
            case Table(elements=elements):
                return self._table(elements)
            case Apply(operator=Operator.AND, arguments=arguments):
                known = self._placement.layout.known_at(self._placement.slot[at])
                rest = [self._texts[i] for i in arguments if i not in known]
                return applied(Operator.AND, rest, []) if len(rest) > 1 else rest[0] if rest else TRUE
            case Apply(operator=operator, arguments=arguments):
                return self._applied(operator, arguments)
            case _:
                raise AssertionError(f"{op} is an atom")

    def _applied(self, operator: Operator, arguments: tuple[int, ...]) -> Text:
        x = [self._ranges[i] for i in arguments]
        if operator in _STARRED:
            run = self._slice(arguments) if len(arguments) >= _MIN_SLICE_LENGTH else None
            if run and operator in (Operator.MIN, Operator.MAX) and not any(r.nan for r in x):
                return Text(f"{operator.value}({run})", Binding.ATOM, 1)
            summed = operator in (Operator.SUM, Operator.COUNT)
            if run and not summed:
                return Text(f"{_STARRED[operator]}(*{run})", Binding.ATOM, 1)
            if summed and len(arguments) > _MAX_SUM_TERMS:
                listed = f"*{run}" if run else ", ".join(self._texts[i].text for i in arguments)
                return Text(f"{_STARRED[operator]}({listed})", Binding.ATOM, 1)
        return applied(operator, [self._texts[i] for i in arguments], x)

    def _table(self, elements: tuple[int, ...]) -> Text:
        whole = self._slice(elements)
        if whole:
            return Text(whole)
        depth = 1 + max(self._texts[i].depth for i in elements)
        listed = ", ".join(self._texts[i].text for i in elements)
        return Text(f"({listed},)", Binding.ATOM, depth)

    def _slice(self, elements: tuple[int, ...]) -> str | None:
        """Return consecutive elements of one sensor as a slice, None for other elements."""
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
