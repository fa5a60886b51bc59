"""A view of lowered code as text for people: an op a line, in prefix notation, then memory and what values
are for. The variants of guards (`loss_aware_guard` and so on) are left out: in a view they equal the guards.

20 number  select 18 11 13  # turned        value 20: 11 where 18 is true, else 13
cell 3 `turned`: number 0.0, then 11 where 19
3 first: present 23, known 5, active 37, guard 44, exclusive 44, sends 56 57
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple

from colony.execute.code import (
    ActuatorCode,
    Apply,
    Code,
    Literal,
    OldCell,
    Op,
    PythonCall,
    SensorElement,
    Table,
)


def listing(code: Code) -> str:
    """Return all of a view as text, except places in the source and what the robot declares."""
    return "\n".join(_lines(code)) + "\n"


def _lines(code: Code) -> Iterator[str]:
    for at, (op, kind) in enumerate(zip(code.ops, code.kinds, strict=True)):
        if at == code.decided:
            yield "decided"
        yield f"{at:4} {kind.value:6}  {_op(op, code)}{f'  # {name}' if (name := code.names.get(at)) else ''}"
    if code.decided == len(code.ops):
        yield "decided"
    for at, cell in enumerate(code.cells):
        start = f"{cell.kind.value} {cell.initial!r}"
        yield f"cell {at} `{cell.name}`: {start}, then {cell.value} where {cell.condition}"
    for name, at in code.memory_cells.items():
        yield f"place `{name}`: cell {at}"
    for call in code.python:
        yield from _python(call)
    for actuator in code.actuators:
        yield from _actuator(actuator)
    for contract in code.contracts:
        yield f"contract {contract.name}: {contract.holds}{' assumed' * contract.assumed}"
    yield f"sensors: {', '.join(sensor.name for sensor in code.sensors) or 'none'}"


def _op(op: Op, code: Code) -> str:
    match op:
        case Apply(operator=operator, arguments=several):
            return " ".join((operator.value, *map(str, several)))
        case Table(elements=several):
            return " ".join(("table", *map(str, several)))
        case Literal(value=value):
            return repr(value)
        case SensorElement(sensor=sensor, index=index):
            return f"{sensor}[{index}]"
        case OldCell(cell=cell):
            return f"old {cell} `{code.cells[cell].name}`"
        case _:
            return " ".join((type(op).__name__, *map(str, astuple(op))))


def _python(call: PythonCall) -> Iterator[str]:
    rate = "" if call.rate_ns is None else f", every {call.rate_ns} ns"
    yield f"Python {call.module}: {call.module_path}:{call.class_name} where {call.present}{rate}"
    for name, value in call.params:
        yield f"  param {name} = {value!r}"
    for read in call.reads:
        elements = " ".join(map(str, read.elements))
        yield f"  reads {read.name} = {f'[{elements}]' if read.array else elements}"
    yield f"  fields: {', '.join(f'{f.name} : {f.type}' for f in call.fields) or 'none'}"


def _actuator(of: ActuatorCode) -> Iterator[str]:
    yield f"actuator {of.actuator.name}"
    for one in of.clients:
        guards = f"present {one.present}, known {one.known}, active {one.active}, "
        guards += f"guard {one.guard}, exclusive {one.exclusive}"
        yield f"  {one.priority} {one.module}: {guards}, sends {' '.join(map(str, one.fields))}"
    for limit in of.limits:
        where = f"where {limit.applies}, known {limit.known}"
        yield f"  limit of field {limit.field_index} {limit.relation} {limit.bound} {where}"
