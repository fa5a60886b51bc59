"""Construction of `Code`: equal ops have one number, and constants are folded."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from struct import pack

from colony.execute.code import Apply, Cell, Kind, Literal, OldCell, Op, Table
from colony.execute.operators import FUNCTIONS, Operator
from colony.execute.signatures import RESULTS
from colony.ir.types import ScalarValue


@dataclass(slots=True)
class _OpenCell:
    name: str
    kind: Kind
    initial: ScalarValue | int
    condition: int
    value: int


@dataclass(slots=True)
class Builder:
    """A growing list of ops and cells. Mutable; `views.trimmed` makes the finished Code smaller."""

    ops: list[Op] = field(default_factory=list)
    kinds: list[Kind] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=dict)
    _index: dict[Hashable, int] = field(default_factory=dict)
    _cells: list[_OpenCell] = field(default_factory=list)
    _cell_names: dict[str, int] = field(default_factory=dict)
    places: dict[str, int] = field(default_factory=dict)

    # --- ops -------------------------------------------------------------------------------------

    def add(self, op: Op, kind: Kind, key: Hashable = None) -> int:
        """Return the number of `op`, added if it is new. `key` replaces `op` where `==` is too coarse."""
        key = op if key is None else key
        at = self._index.get(key)
        if at is None:
            at = self._index[key] = len(self.ops)
            self.ops.append(op)
            self.kinds.append(kind)
        return at

    def literal(self, value: ScalarValue) -> int:
        """Return a number or bool; 0.0 and -0.0 differ."""
        if isinstance(value, bool):
            return self.add(Literal(value), Kind.BOOL, ("bool", value))
        return self.add(Literal(float(value)), Kind.NUMBER, ("number", pack("<d", value)))

    def time(self, nanoseconds: int) -> int:
        """Return a time or duration."""
        return self.add(Literal(nanoseconds), Kind.TIME, ("time", nanoseconds))

    def table(self, elements: tuple[int, ...]) -> int:
        """Return a table of the given elements."""
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
            return self._folded(operator, arguments)
        return self.add(Apply(operator, arguments), RESULTS[operator])

    def _folded(self, operator: Operator, arguments: tuple[int, ...]) -> int:
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
        """Return the conjunction; true without conditions."""
        return self._joined(Operator.AND, conditions, neutral=True)

    def either(self, *conditions: int) -> int:
        """Return the disjunction; false without conditions."""
        return self._joined(Operator.OR, conditions, neutral=False)

    def _joined(self, operator: Operator, conditions: Sequence[int], neutral: bool) -> int:
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

    def is_true(self, value: int) -> bool:
        """Return True if the value is the constant `true`."""
        op = self.ops[value]
        return isinstance(op, Literal) and op.value is True

    # --- memory ----------------------------------------------------------------------------------

    def cell(self, name: str, kind: Kind, initial: ScalarValue | int, *places: str) -> int:
        """Return the old value of the cell `name`, added if it is new; `keep` must be called for it once.

        `places` are its names in `ir.memory`.
        """
        at = self._cell_names.get(name)
        if at is None:
            at = self._cell_names[name] = len(self._cells)
            never = self.literal(False)
            self._cells.append(_OpenCell(name, kind, initial, never, never))
        self.places.update(dict.fromkeys(places, at))
        return self.add(OldCell(at), kind)

    def keep(self, old: int, condition: int, value: int) -> None:
        """Write `value` to the cell read by `old`, at the end of a frame in which `condition` is true."""
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
