"""Builds `Code`: gives equal ops one number, folds constants, and leaves out what nothing needs."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from struct import pack

from colony.execute.code import (
    ActuatorCode,
    Apply,
    Cell,
    ClientCode,
    Code,
    ContractCode,
    Kind,
    LimitCode,
    Literal,
    OldCell,
    Op,
    PythonCall,
    PythonRead,
    SensorElement,
    SensorFresh,
    Table,
    live,
    remapped,
    roots,
)
from colony.execute.operators import FUNCTIONS, Operator
from colony.ir.program import Sensor
from colony.ir.types import ScalarValue

_BOOLS = frozenset(
    {
        Operator.LESS,
        Operator.LESS_EQUAL,
        Operator.EQUAL,
        Operator.NOT_EQUAL,
        Operator.FINITE,
        Operator.NOT,
        Operator.AND,
        Operator.OR,
        Operator.PICK_BOOL,
        Operator.TIME_LESS,
    }
)
_TIMES = frozenset({Operator.TIME_ADD, Operator.TIME_SUBTRACT})


@dataclass(slots=True)
class _OpenCell:
    name: str
    kind: Kind
    initial: ScalarValue | int
    condition: int
    value: int


@dataclass(slots=True)
class Builder:
    """A growing list of ops and cells. Mutable; `trimmed` makes the finished Code smaller."""

    ops: list[Op] = field(default_factory=list)
    kinds: list[Kind] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=dict)
    _index: dict[Hashable, int] = field(default_factory=dict)
    _cells: list[_OpenCell] = field(default_factory=list)
    _cell_names: dict[str, int] = field(default_factory=dict)
    places: dict[str, int] = field(default_factory=dict)

    # --- ops -------------------------------------------------------------------------------------

    def add(self, op: Op, kind: Kind, key: Hashable = None) -> int:
        """The number of `op`, added if it is new. `key` stands for it where `==` is too coarse."""
        key = op if key is None else key
        at = self._index.get(key)
        if at is None:
            at = self._index[key] = len(self.ops)
            self.ops.append(op)
            self.kinds.append(kind)
        return at

    def literal(self, value: ScalarValue) -> int:
        """A number or bool; 0.0 and -0.0 are two."""
        if isinstance(value, bool):
            return self.add(Literal(value), Kind.BOOL, ("bool", value))
        return self.add(Literal(float(value)), Kind.NUMBER, ("number", pack("<d", value)))

    def time(self, nanoseconds: int) -> int:
        """A time or duration."""
        return self.add(Literal(nanoseconds), Kind.TIME, ("time", nanoseconds))

    def table(self, elements: tuple[int, ...]) -> int:
        return self.add(Table(elements), Kind.TABLE)

    def apply(self, operator: Operator, *arguments: int) -> int:
        """An operator of values; of constants, the constant."""
        if operator is Operator.SELECT:
            return self._select(*arguments)
        ops = self.ops
        for i in arguments:
            if type(ops[i]) is not Literal:
                break
        else:
            return self._folded(operator, arguments)
        return self.add(Apply(operator, arguments), self._kind(operator))

    def _folded(self, operator: Operator, arguments: tuple[int, ...]) -> int:
        values = []
        for i in arguments:
            op = self.ops[i]
            assert isinstance(op, Literal)
            values.append(op.value)
        value = FUNCTIONS[operator](*values)
        return self.time(value) if operator in _TIMES else self.literal(value)

    def _kind(self, operator: Operator) -> Kind:
        return Kind.BOOL if operator in _BOOLS else Kind.TIME if operator in _TIMES else Kind.NUMBER

    def _select(self, condition: int, yes: int, no: int) -> int:
        op = self.ops[condition]
        if isinstance(op, Literal):
            return yes if op.value else no
        if yes == no:
            return yes
        return self.add(Apply(Operator.SELECT, (condition, yes, no)), self.kinds[yes])

    def both(self, *conditions: int) -> int:
        """All of them; true of none."""
        return self._joined(Operator.AND, conditions, neutral=True)

    def either(self, *conditions: int) -> int:
        """Any of them; false of none."""
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
        op = self.ops[condition]
        if isinstance(op, Apply) and op.operator is Operator.NOT:
            return op.arguments[0]
        return self.apply(Operator.NOT, condition)

    def is_true(self, value: int) -> bool:
        op = self.ops[value]
        return isinstance(op, Literal) and op.value is True

    # --- memory ----------------------------------------------------------------------------------

    def cell(self, name: str, kind: Kind, initial: ScalarValue | int, *places: str) -> int:
        """The old value of the cell called `name`, which is made if it is new; it has to be `kept` once.

        `places` are what `ir.memory` calls it.
        """
        at = self._cell_names.get(name)
        if at is None:
            at = self._cell_names[name] = len(self._cells)
            never = self.literal(False)
            self._cells.append(_OpenCell(name, kind, initial, never, never))
        self.places.update(dict.fromkeys(places, at))
        return self.add(OldCell(at), kind)

    def keep(self, old: int, condition: int, value: int) -> None:
        """At the end of a frame in which `condition` is true the cell read by `old` takes `value`."""
        op = self.ops[old]
        assert isinstance(op, OldCell)
        cell = self._cells[op.cell]
        cell.condition, cell.value = condition, value

    def cells(self) -> tuple[Cell, ...]:
        return tuple(
            Cell(name=c.name, kind=c.kind, initial=c.initial, condition=c.condition, value=c.value)
            for c in self._cells
        )


def trimmed(code: Code, *, every_sensor: bool) -> Code:
    """`code` without the ops, cells and (unless `every_sensor`) sensors that no result depends on."""
    flags, used_cells = live(code.ops, code.cells, roots(code))
    kept = [i for i, flag in enumerate(flags) if flag]
    number = {old: new for new, old in enumerate(kept)}
    cell_number = {old: new for new, old in enumerate(sorted(used_cells))}
    cells = tuple(
        replace(c, condition=number[c.condition], value=number[c.value])
        for c in (code.cells[i] for i in cell_number)
    )
    ops = tuple(remapped(code.ops[i], number, cell_number) for i in kept)
    read = {op.sensor for op in ops if isinstance(op, SensorFresh | SensorElement)}
    return Code(
        ops=ops,
        kinds=tuple(code.kinds[i] for i in kept),
        decided=sum(1 for i in kept if i < code.decided),
        sensors=code.sensors if every_sensor else _only(code.sensors, read),
        cells=cells,
        python=tuple(_python(call, number) for call in code.python),
        actuators=tuple(_actuator(actuator, number) for actuator in code.actuators),
        contracts=tuple(
            ContractCode(name=c.name, present=number[c.present], value=number[c.value])
            for c in code.contracts
        ),
        names={number[i]: name for i, name in code.names.items() if i in number},
        places={name: cell_number[i] for name, i in code.places.items() if i in cell_number},
    )


def _only(sensors: tuple[Sensor, ...], names: set[str]) -> tuple[Sensor, ...]:
    return tuple(s for s in sensors if s.name in names)


def _python(call: PythonCall, number: dict[int, int]) -> PythonCall:
    reads = tuple(
        PythonRead(name=r.name, elements=tuple(number[i] for i in r.elements), array=r.array)
        for r in call.reads
    )
    return replace(call, present=number[call.present], reads=reads)


def _actuator(actuator: ActuatorCode, number: dict[int, int]) -> ActuatorCode:
    clients = tuple(
        ClientCode(
            module=c.module,
            priority=c.priority,
            present=number[c.present],
            active=number[c.active],
            guard=number[c.guard],
            exclusive=number[c.exclusive],
            fields=tuple([number[i] for i in c.fields]),
            span=c.span,
        )
        for c in actuator.clients
    )
    limits = tuple(
        LimitCode(
            field_index=limit.field_index,
            relation=limit.relation,
            applies=number[limit.applies],
            bound=number[limit.bound],
        )
        for limit in actuator.limits
    )
    return ActuatorCode(actuator=actuator.actuator, clients=clients, limits=limits)
