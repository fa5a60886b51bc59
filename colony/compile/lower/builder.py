"""Construction of `Code`: equal ops share one number, and constants are folded."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from struct import pack

from colony.execute.code import Apply, Cell, Kind, Literal, OldCell, Op, Table
from colony.execute.operators import FUNCTIONS, Operator
from colony.execute.validity import RESULTS
from colony.ir.types import ScalarValue


@dataclass(slots=True)
class _OpenCell:
    name: str
    kind: Kind
    initial: ScalarValue | int
    condition: int
    value: int


@dataclass(slots=True)
class CodeBuilder:
    """A growing list of ops and cells; `places` are the cells by their names in `ir.memory`. Mutable.

    `views.trimmed` removes what is not needed.
    """

    ops: list[Op] = field(default_factory=list)
    kinds: list[Kind] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=dict)
    _index: dict[Hashable, int] = field(default_factory=dict)
    _cells: list[_OpenCell] = field(default_factory=list)
    _cell_names: dict[str, int] = field(default_factory=dict)
    places: dict[str, int] = field(default_factory=dict)

    # --- ops -------------------------------------------------------------------------------------

    def add(self, op: Op, kind: Kind, key: Hashable = None) -> int:
        """Return the number of `op`; add it if it is new. `key` identifies `op` where `==` is too coarse."""
        key = op if key is None else key
        index = self._index.get(key)
        if index is None:
            index = self._index[key] = len(self.ops)
            self.ops.append(op)
            self.kinds.append(kind)
        return index

    def literal(self, value: ScalarValue) -> int:
        """Return the number of a constant; 0.0 and -0.0 differ."""
        if isinstance(value, bool):
            return self.add(Literal(value), Kind.BOOL, ("bool", value))
        return self.add(Literal(float(value)), Kind.NUMBER, ("number", pack("<d", value)))

    def time(self, nanoseconds: int) -> int:
        """Return the number of a constant time or duration."""
        return self.add(Literal(nanoseconds), Kind.TIME, ("time", nanoseconds))

    def table(self, elements: tuple[int, ...]) -> int:
        """Return the number of a table of the given elements."""
        return self.add(Table(elements), Kind.TABLE)

    def apply(self, operator: Operator, *arguments: int) -> int:
        """Apply an operator to values; for constants, return the constant result."""
        if operator is Operator.SELECT:
            return self._select(*arguments)
        ops = self.ops
        for i in arguments:
            if type(ops[i]) is not Literal:
                break
        else:
            return self._fold(operator, arguments)
        return self.add(Apply(operator, arguments), RESULTS[operator])

    def _fold(self, operator: Operator, arguments: tuple[int, ...]) -> int:
        values = []
        for i in arguments:
            op = self.ops[i]
            assert isinstance(op, Literal)
            values.append(op.value)
        value = FUNCTIONS[operator](*values)
        return self.time(value) if RESULTS[operator] is Kind.TIME else self.literal(value)

    def _select(self, condition: int, yes: int, no: int) -> int:
        op = self.ops[condition]
        if isinstance(op, Literal):
            return yes if op.value else no
        if yes == no:
            return yes
        return self.add(Apply(Operator.SELECT, (condition, yes, no)), self.kinds[yes])

    def both(self, *conditions: int) -> int:
        """Return the conjunction, which is true without conditions."""
        return self._connect(Operator.AND, conditions, neutral=True)

    def either(self, *conditions: int) -> int:
        """Return the disjunction, which is false without conditions."""
        return self._connect(Operator.OR, conditions, neutral=False)

    def _connect(self, operator: Operator, conditions: Sequence[int], neutral: bool) -> int:
        kept = []
        for condition in dict.fromkeys(conditions):
            op = self.ops[condition]
            if not isinstance(op, Literal):
                kept.append(condition)
            elif op.value is not neutral:
                return condition
        if len(kept) > 1:
            return self.add(Apply(operator, tuple(kept)), Kind.BOOL)
        return kept[0] if kept else self.literal(neutral)

    def negation(self, condition: int) -> int:
        """Return the negation of a condition."""
        op = self.ops[condition]
        if isinstance(op, Apply) and op.operator is Operator.NOT:
            return op.arguments[0]
        return self.apply(Operator.NOT, condition)

    def conjuncts(self, condition: int) -> frozenset[int]:
        """Return the conditions whose conjunction a condition is: itself, if it is no conjunction."""
        op = self.ops[condition]
        if isinstance(op, Apply) and op.operator is Operator.AND:
            return frozenset(op.arguments)
        return frozenset() if self.is_true(condition) else frozenset({condition})

    def is_true(self, value: int) -> bool:
        """Return True if the value is the constant `true`."""
        op = self.ops[value]
        return isinstance(op, Literal) and op.value is True

    # --- memory ----------------------------------------------------------------------------------

    def cell(self, name: str, kind: Kind, initial: ScalarValue | int, *memory_names: str) -> int:
        """Return the number of the op that reads the cell `name`; add the cell if it is new.

        Call `keep` once for each cell, to write it. `memory_names` are the cell's names in `ir.memory`.
        """
        index = self._cell_names.get(name)
        if index is None:
            index = self._cell_names[name] = len(self._cells)
            never = self.literal(False)
            self._cells.append(_OpenCell(name, kind, initial, never, never))
        self.places.update(dict.fromkeys(memory_names, index))
        return self.add(OldCell(index), kind)

    def keep(self, old: int, condition: int, value: int) -> None:
        """Write `value` to the cell that op `old` reads, at the end of frames with a true `condition`."""
        op = self.ops[old]
        assert isinstance(op, OldCell)
        cell = self._cells[op.cell]
        cell.condition, cell.value = condition, value

    def cells(self) -> tuple[Cell, ...]:
        """Return all memory cells."""
        return tuple(
            Cell(name=c.name, kind=c.kind, initial=c.initial, condition=c.condition, value=c.value)
            for c in self._cells
        )
