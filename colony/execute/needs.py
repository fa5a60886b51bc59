"""Dependencies of each client of a program on its table: sensors, modules in Python, memory.

The answers for all clients are computed together. Sets are bit masks in one int each; with thousands of
clients, sets of objects would be too slow.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from colony.execute.code import (
    ActuatorCode,
    ClientCode,
    Code,
    OldCell,
    Op,
    PythonActive,
    PythonField,
    SensorElement,
    SensorFresh,
    operands,
)

ClientKey = tuple[str, str]
"""Actuator and module of a client."""


class Needs(NamedTuple):
    """The dependencies of a client: names of sensors and of modules in Python, numbers of cells."""

    sensors: tuple[str, ...]
    python_modules: tuple[str, ...]
    cells: tuple[int, ...]


def needs_of_clients(code: Code) -> Mapping[ClientKey, Needs]:
    """Return what each client needs, its limits and all that its memory comes from included.

    Args:
        code: a view of clients (`views.of_clients`), in which `guard` is the guard by which a client speaks;
            of the code of a whole program the answer is another.
    """
    sensors = [s.name for s in code.sensors]
    modules = python_modules(code)
    first_sensor = len(code.cells)
    first_module = first_sensor + len(sensors)
    bits: dict[object, int] = {i: 1 << i for i in range(first_sensor)}
    bits |= {("sensor", name): 1 << first_sensor + i for i, name in enumerate(sensors)}
    bits |= {("module", name): 1 << first_module + i for i, name in enumerate(modules)}
    masks: list[int] = []
    for op in code.ops:
        mask = bits.get(_source_key(op), 0)
        for at in operands(op):
            mask |= masks[at]
        masks.append(mask)
    cells = _cell_closure(code, masks)
    found: dict[ClientKey, Needs] = {}
    for one in code.actuators:
        for client in one.clients:
            mask = 0
            for at in _roots(one, client):
                mask |= masks[at]
            mask = _with_memory(mask, cells)
            used = tuple(_bit_indices(mask))
            found[one.actuator.name, client.module] = Needs(
                sensors=tuple([sensors[i - first_sensor] for i in used if first_sensor <= i < first_module]),
                python_modules=tuple([modules[i - first_module] for i in used if i >= first_module]),
                cells=tuple([i for i in used if i < first_sensor]),
            )
    return found


def python_modules(code: Code) -> tuple[str, ...]:
    """Return the modules in Python whose answers a code is computed from."""
    called = (op.module for op in code.ops if isinstance(op, PythonActive | PythonField))
    return tuple(dict.fromkeys(called))


def _source_key(op: Op) -> object:
    match op:
        case OldCell(cell=cell):
            return cell
        case SensorFresh(sensor=sensor) | SensorElement(sensor=sensor):
            return ("sensor", sensor)
        case PythonActive(module=module) | PythonField(module=module):
            return ("module", module)
        case _:
            return None


def _roots(one: ActuatorCode, client: ClientCode) -> Iterator[int]:
    yield from (client.present, client.guard, *client.fields, *client.conditions.values())
    for limit in one.limits:
        yield from (limit.applies, limit.bound)


def _cell_closure(code: Code, masks: list[int]) -> list[int]:
    """Return, for each cell, itself and all that its value comes from, over any number of frames."""
    cells = [1 << i | masks[c.condition] | masks[c.value] for i, c in enumerate(code.cells)]
    changed = True
    while changed:
        changed = False
        for i, mask in enumerate(cells):
            closed = _with_memory(mask, cells)
            if closed != mask:
                cells[i], changed = closed, True
    return cells


def _with_memory(mask: int, cells: list[int]) -> int:
    """Return `mask` with all that its cells come from."""
    closed = mask
    for i in _bit_indices(mask & ((1 << len(cells)) - 1)):
        closed |= cells[i]
    return closed


def _bit_indices(mask: int) -> Iterator[int]:
    """Yield the numbers of the bits that are set, in rising order."""
    digits = bin(mask)[:1:-1]
    at = digits.find("1")
    while at >= 0:
        yield at
        at = digits.find("1", at + 1)
