"""Validation of a compiled program from an untrusted source.

msgspec has checked all types. Here every reference must have a valid target, so that no operation can raise,
block or allocate more memory in any frame.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from math import inf, isfinite
from types import MappingProxyType
from typing import assert_never

from colony.execute.code import (
    ActuatorCode,
    Apply,
    Code,
    Commanded,
    FrameTime,
    Kind,
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
from colony.execute.compiled import Compiled, is_source_path
from colony.execute.operators import Operator
from colony.ir.program import ActuatorField, Before, Role, Sensor, role_name
from colony.ir.types import BOOL, Array, Bool, ScalarValue, Type, element_type

# --- signatures ---------------------------------------------------------------------------------------
#
# The signatures of operators: the kinds of their arguments and results.

_N, _B, _T, _TABLE = Kind.NUMBER, Kind.BOOL, Kind.TIME, Kind.TABLE

_FIXED: Mapping[Operator, tuple[tuple[Kind, ...], Kind]] = MappingProxyType(
    {
        **dict.fromkeys(
            (
                Operator.NEGATE,
                Operator.ABS,
                Operator.SIGN,
                Operator.SQRT,
                Operator.FLOOR,
                Operator.CEIL,
                Operator.ROUND,
                Operator.SIN,
                Operator.COS,
                Operator.TAN,
                Operator.ASIN,
                Operator.ACOS,
            ),
            ((_N,), _N),
        ),
        **dict.fromkeys(
            (
                Operator.ADD,
                Operator.SUBTRACT,
                Operator.MULTIPLY,
                Operator.DIVIDE,
                Operator.MODULO,
                Operator.ATAN2,
            ),
            ((_N, _N), _N),
        ),
        Operator.LESS: ((_N, _N), _B),
        Operator.LESS_EQUAL: ((_N, _N), _B),
        Operator.EQUAL: ((_N, _N), _B),
        Operator.NOT_EQUAL: ((_N, _N), _B),
        Operator.FINITE: ((_N,), _B),
        Operator.NOT: ((_B,), _B),
        Operator.PICK_NUMBER: ((_TABLE, _N), _N),
        Operator.PICK_BOOL: ((_TABLE, _N), _B),
        Operator.TIME_ADD: ((_T, _T), _T),
        Operator.TIME_SUBTRACT: ((_T, _T), _T),
        Operator.TIME_LESS: ((_T, _T), _B),
        Operator.SECONDS: ((_T,), _N),
    }
)

_VARIADIC: Mapping[Operator, tuple[Kind, Kind]] = MappingProxyType(
    {
        Operator.MIN: (_N, _N),
        Operator.MAX: (_N, _N),
        Operator.SUM: (_N, _N),
        Operator.INDEX_OF_MIN: (_N, _N),
        Operator.INDEX_OF_MAX: (_N, _N),
        Operator.COUNT: (_B, _N),
        Operator.AND: (_B, _B),
        Operator.OR: (_B, _B),
    }
)


RESULTS: Mapping[Operator, Kind] = MappingProxyType(
    {operator: result for operator, (_, result) in (*_FIXED.items(), *_VARIADIC.items())}
)
"""Kind of the result of each operator except SELECT."""


def result_of(operator: Operator, arguments: Sequence[Kind]) -> Kind | None:
    """Return the kind of an operator's result for arguments of these kinds, None if they do not fit."""
    if operator is Operator.SELECT:
        fits = len(arguments) == 3 and arguments[0] is _B and arguments[1] is arguments[2] is not _TABLE
        return arguments[1] if fits else None
    if operator in (Operator.EQUAL, Operator.NOT_EQUAL) and tuple(arguments) == (_B, _B):
        return _B
    if operator in _VARIADIC:
        argument, result = _VARIADIC[operator]
        return result if arguments and all(kind is argument for kind in arguments) else None
    expected, result = _FIXED[operator]
    return result if tuple(arguments) == expected else None


# --- validity -----------------------------------------------------------------------------------------

MAX_ARRAY_SIZE = 100_000
"""Maximum number of elements of a sensor's array."""

MAX_TIME_NS = 2**62
"""Bound on the absolute value of times in a program: the sum of two fits into 64 bits."""

_NAME = re.compile(r"[A-Za-z_]\w{0,254}([.:]\w{1,255}){0,12}")
_SIMPLE_NAME = re.compile(r"[A-Za-z_]\w{0,254}")


class InvalidProgramError(ValueError):
    """A compiled program is invalid; the message gives the reason."""


def check(compiled: Compiled) -> None:
    """Check all of a compiled program, in time linear in its size.

    Raises:
        InvalidProgramError: it is invalid.
    """
    _Check(compiled).all()


def _expect(holds: bool, message: str) -> None:
    if not holds:
        raise InvalidProgramError(message)


def _kind(type_: Type) -> Kind:
    return Kind.BOOL if isinstance(element_type(type_), Bool) else Kind.NUMBER


class _Check:
    def __init__(self, compiled: Compiled) -> None:
        self.compiled = compiled
        self.code: Code = compiled.code
        self.sensors = {s.name: s for s in self.code.sensors}
        self.python = {call.module: call for call in self.code.python}
        self.actuators = {a.actuator.name: a for a in self.code.actuators}

    def all(self) -> None:
        code, compiled = self.code, self.compiled
        _expect(0 < compiled.frame_ns < MAX_TIME_NS, f"the frame period is {compiled.frame_ns} ns")
        _expect(_SIMPLE_NAME.fullmatch(compiled.name) is not None, f"{compiled.name[:40]!r} is not a name")
        self._sources()
        _expect(len(code.kinds) == len(code.ops), "operations and kinds differ in number")
        _expect(0 <= code.decided <= len(code.ops), "`decided` is not an operation")
        self._names()
        for sensor in code.sensors:
            _check_sensor(sensor)
            if sensor.sent is not None:
                self._check_sent(sensor, sensor.sent)
        for position, op in enumerate(code.ops):
            _expect(
                self._result_kind(position, op) is code.kinds[position],
                f"operation {position} ({type(op).__name__}) is malformed",
            )
        for cell in code.cells:
            _expect(
                _has_kind(cell.initial, cell.kind),
                f"the initial value of the cell `{cell.name}` is not of its kind",
            )
            _expect(
                cell.kind is not Kind.TIME or abs(cell.initial) <= MAX_TIME_NS,
                f"the initial time of the cell `{cell.name}` is out of range",
            )
            self._refer(cell.name, cell.kind, cell.value)
            _expect(
                not _is_difference(code.ops[cell.value]),
                f"the cell `{cell.name}` stores a difference of times",
            )
            self._refer(cell.name, Kind.BOOL, cell.condition)
        self._python_calls()
        for actuator in code.actuators:
            self._actuator(actuator)
        for contract in code.contracts:
            self._refer(contract.name, Kind.BOOL, contract.holds, contract.unsimplified)
            named = () if contract.in_time is None else contract.in_time.actuators
            _expect(self.actuators.keys() >= set(named), f"{contract.name} names no actuator")
        _expect(all(0 <= i < len(code.ops) for i in code.names), "a name refers to no operation")
        _expect(
            all(0 <= i < len(code.cells) for i in code.memory_cells.values()),
            "a name of memory refers to no cell",
        )

    def _check_sent(self, sensor: Sensor, sent: Before) -> None:
        """Check that a sensor is a field of an actuator, of one type, or the role of a module."""
        found = self.actuators.get(sent.actuator)
        fields = () if found is None else found.actuator.fields
        if isinstance(sent.of, Role):
            name = role_name(sent.actuator, sent.of)
            is_named = sensor.name == name and _NAME.fullmatch(sent.of.module) is not None
            _expect(found is not None and is_named, f"{sensor.name[:80]} is not the role of a module")
            _expect(sensor.type == BOOL and sensor.default is False, f"{sensor.name} is not false by default")
            return
        _expect(0 <= sent.of < len(fields), f"{sensor.name} is no field of an actuator")
        _expect(fields[sent.of].type == sensor.type, f"{sensor.name} is not of its field's type")

    def _names(self) -> None:
        code = self.code
        roles = {s.name for s in code.sensors if s.sent is not None and isinstance(s.sent.of, Role)}
        for group, names in (
            ("sensors", [s.name for s in code.sensors]),
            ("modules in Python", [c.module for c in code.python]),
            ("actuators", [a.actuator.name for a in code.actuators]),
            *((a.actuator.name, [c.module for c in a.clients]) for a in code.actuators),
            *((a.actuator.name, [f.name for f in a.actuator.fields]) for a in code.actuators),
        ):
            _expect(len(set(names)) == len(names), f"duplicate name among {group}")
            for name in names:
                is_name = name in roles or _NAME.fullmatch(name) is not None
                _expect(is_name, f"{name[:40]!r} is not a name")
        _expect(len({c.name for c in code.cells}) == len(code.cells), "duplicate name among the cells")

    def _sources(self) -> None:
        """Check that each source has its own path inside the folder that a recording is unpacked into."""
        compiled = self.compiled
        paths = [(source.kind, source.path) for source in compiled.sources]
        _expect(len(set(paths)) == len(paths), "duplicate source")
        for _, path in paths:
            _expect(is_source_path(path) and path.isprintable(), f"{path[:40]!r} is not a relative path")
        _expect(
            not paths or ("behavior", compiled.root) in paths, "the compiled file is not among the sources"
        )

    def _refer(self, owner: str, kind: Kind, *references: int, below: int | None = None) -> None:
        """Expect references to values of a kind, with indices below `below`."""
        end = len(self.code.ops) if below is None else below
        for position in references:
            _expect(
                0 <= position < end and self.code.kinds[position] is kind,
                f"{owner} refers to an invalid operation",
            )

    # --- operations ------------------------------------------------------------------------------

    def _result_kind(self, position: int, op: Op) -> Kind | None:
        """Return the kind of an operation's result; None if it is malformed."""
        code = self.code
        match op:
            case Apply(operator=operator, arguments=arguments):
                if not all(0 <= i < position for i in arguments):
                    return None
                kind = result_of(operator, [code.kinds[i] for i in arguments])
                return kind if self._fits(operator, [code.ops[i] for i in arguments], kind) else None
            case Table(elements=elements):
                found = {code.kinds[i] if 0 <= i < position else None for i in elements}
                return Kind.TABLE if found in ({Kind.NUMBER}, {Kind.BOOL}) else None
            case Literal(value=value):
                return _kind_of_literal(value)
            case FrameTime() | Restarted():
                return Kind.TIME if isinstance(op, FrameTime) else Kind.BOOL
            case OldCell(cell=cell):
                return code.cells[cell].kind if 0 <= cell < len(code.cells) else None
            case SensorFresh(sensor=sensor):
                return Kind.BOOL if sensor in self.sensors else None
            case SensorElement(sensor=name, index=index):
                found_sensor = self.sensors.get(name)
                return None if found_sensor is None else _element(found_sensor.type, index)
            case PythonActive(module=module) | PythonBlind(module=module):
                return Kind.BOOL if module in self.python else None
            case PythonField(module=module, index=index):
                call = self.python.get(module)
                return _field(() if call is None else call.fields, index)
            case Lost():
                return Kind.BOOL
            case Winner(actuator=actuator) | Commanded(actuator=actuator):
                return Kind.BOOL if position >= code.decided and actuator in self.actuators else None
            case Sent(actuator=actuator, index=index):
                found_actuator = self.actuators.get(actuator) if position >= code.decided else None
                return _field(() if found_actuator is None else found_actuator.actuator.fields, index)
            case _:
                assert_never(op)

    def _fits(self, operator: Operator, arguments: Sequence[Op], kind: Kind | None) -> bool:
        """Return True if a table has elements of the kind that is picked from it, and times stay bounded.

        A sum of times must be the frame's time plus a constant; a difference may only be converted to
        seconds.
        """
        if operator is not Operator.SECONDS and any(map(_is_difference, arguments)):
            return False
        match operator, arguments:
            case ((Operator.PICK_NUMBER | Operator.PICK_BOOL), (Table(elements=elements), _)):
                return self.code.kinds[elements[0]] is kind
            case Operator.TIME_ADD, (time, duration):
                return isinstance(time, FrameTime) and isinstance(duration, Literal)
            case _:
                return True

    # --- structure -------------------------------------------------------------------------------

    def _python_calls(self) -> None:
        """Check that the inputs of Python modules precede the first operation that needs an answer."""
        kinds = (PythonActive, PythonBlind, PythonField)
        answers = (i for i, op in enumerate(self.code.ops) if isinstance(op, kinds))
        first = next(answers, self.code.decided)
        for call in self.code.python:
            self._refer(call.module, Kind.BOOL, call.present, below=first)
            for read in call.reads:
                _expect(
                    read.array or len(read.elements) == 1,
                    f"{call.module} reads a scalar that has several elements",
                )
                for position in read.elements:
                    _expect(
                        0 <= position < first, f"{call.module} reads an operation that comes after its call"
                    )
            _check_fields(call.fields)

    def _actuator(self, actuator_code: ActuatorCode) -> None:
        actuator, decided = actuator_code.actuator, self.code.decided
        name, fields = actuator.name, actuator.fields
        _check_fields(fields)
        kinds = [_kind(f.type) for f in fields]
        for values in () if actuator.idle is None else (actuator.idle,):
            fits = len(values) == len(kinds) and all(map(_has_kind, values, kinds))
            _expect(fits, f"the idle command of {name} does not have its fields")
            _expect(all(map(_is_within, values, fields)), f"the idle command of {name} is out of range")
        _expect(actuator.idle is not None or actuator.server != "RServer", f"{name} has no idle command")
        priorities = [client.priority for client in actuator_code.clients]
        _expect(
            priorities == list(range(len(priorities), 0, -1)), f"priorities of {name} are not n, ..., 2, 1"
        )
        for client in actuator_code.clients:
            self._refer(name, Kind.BOOL, *client.conditions.values(), below=decided)
            _expect(len(client.fields) == len(fields), f"{name}/{client.module} does not command all fields")
            for kind, position in zip(kinds, client.fields, strict=True):
                self._refer(name, kind, position, below=decided)
        for limit in actuator_code.limits:
            _expect(_field(fields, limit.field_index) is Kind.NUMBER, f"a limit of {name} is not on a number")
            self._refer(name, Kind.BOOL, limit.applies, limit.known, below=decided)
            self._refer(name, Kind.NUMBER, limit.bound, below=decided)


def _check_sensor(sensor: Sensor) -> None:
    name = sensor.name
    _expect(
        not isinstance(sensor.type, Array) or 0 < sensor.type.size <= MAX_ARRAY_SIZE,
        f"the size of {name} is out of range",
    )
    _expect(isfinite(sensor.factor) and sensor.factor != 0, f"the factor of {name} is not valid")
    _check_range(sensor)
    default = sensor.default
    fits = default is None or (_has_kind(default, _kind(sensor.type)) and _is_within(default, sensor))
    _expect(fits, f"the default of {name} is not a value that it can have")
    _expect(
        sensor.within_ns is None or 0 < sensor.within_ns <= MAX_TIME_NS, f"`within` of {name} is out of range"
    )


def _check_fields(fields: Iterable[ActuatorField]) -> None:
    for field in fields:
        _expect(isfinite(field.factor) and field.factor != 0, f"the factor of {field.name} is not valid")
        _check_range(field)
        fits = field.default is None or (
            _has_kind(field.default, _kind(field.type)) and _is_within(field.default, field)
        )
        _expect(fits, f"the default of {field.name} is not a value that it can have")


def _check_range(quantity: Sensor | ActuatorField) -> None:
    low = -inf if quantity.low is None else quantity.low
    high = inf if quantity.high is None else quantity.high
    _expect(low <= high, f"the range of {quantity.name} is empty")


def _is_within(value: ScalarValue, quantity: Sensor | ActuatorField) -> bool:
    """Return True for a finite number in the range."""
    if isinstance(value, bool):
        return True
    above = quantity.low is None or value >= quantity.low
    return isfinite(value) and above and (quantity.high is None or value <= quantity.high)


def _kind_of_literal(value: float | bool) -> Kind | None:
    match value:
        case bool():
            return Kind.BOOL
        case int():
            return Kind.TIME if abs(value) <= MAX_TIME_NS else None
        case _:
            return Kind.NUMBER


def _is_difference(op: Op) -> bool:
    return isinstance(op, Apply) and op.operator is Operator.TIME_SUBTRACT


def _field(fields: Sequence[ActuatorField], index: int) -> Kind | None:
    return _kind(fields[index].type) if 0 <= index < len(fields) else None


def _element(type_: Type, index: int) -> Kind | None:
    size = type_.size if isinstance(type_, Array) else 1
    return _kind(type_) if 0 <= index < size else None


def _has_kind(value: object, kind: Kind) -> bool:
    expected = {Kind.BOOL: bool, Kind.NUMBER: float, Kind.TIME: int}.get(kind)
    return type(value) is expected
