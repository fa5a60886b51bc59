"""What each client of a program needs of its table: sensors, modules in Python, memory. One pass for all."""

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
    """What a client needs: names of sensors and of modules in Python, numbers of cells."""

    sensors: tuple[str, ...]
    python_modules: tuple[str, ...]
    cells: tuple[int, ...]


def needs_of_clients(code: Code) -> Mapping[ClientKey, Needs]:
    """Return what each client needs, its limits and all that its memory comes from included.

    Sets are bits of one number each, so that a program of thousands of clients takes no longer than it has
    operations and bits.
    """
    sensors = [s.name for s in code.sensors]
    called = (op.module for op in code.ops if isinstance(op, PythonActive | PythonField))
    modules = list(dict.fromkeys(called))
    names: list[object] = [
        *range(len(code.cells)),
        *(("s", s) for s in sensors),
        *(("m", m) for m in modules),
    ]
    bits = {name: 1 << i for i, name in enumerate(names)}
    masks: list[int] = []
    for op in code.ops:
        mask = bits.get(_own(op), 0)
        for at in operands(op):
            mask |= masks[at]
        masks.append(mask)
    cells = _closed(code, masks)
    found: dict[ClientKey, Needs] = {}
    for one in code.actuators:
        for client in one.clients:
            mask = 0
            for at in _roots(one, client):
                mask |= masks[at]
            mask = _with_memory(mask, cells)
            used = [names[i] for i in _numbers(mask)]
            found[one.actuator.name, client.module] = Needs(
                sensors=tuple([s for s in sensors if ("s", s) in used]),
                python_modules=tuple([m for m in modules if ("m", m) in used]),
                cells=tuple([i for i in used if isinstance(i, int)]),
            )
    return found


def _own(op: Op) -> object:
    match op:
        case OldCell(cell=cell):
            return cell
        case SensorFresh(sensor=sensor) | SensorElement(sensor=sensor):
            return ("s", sensor)
        case PythonActive(module=module) | PythonField(module=module):
            return ("m", module)
        case _:
            return None


def _roots(one: ActuatorCode, client: ClientCode) -> Iterator[int]:
    yield from (client.present, client.guard, *client.fields, *client.conditions.values())
    for limit in one.limits:
        yield from (limit.applies, limit.bound)


def _closed(code: Code, masks: list[int]) -> list[int]:
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
    for i in _numbers(mask & ((1 << len(cells)) - 1)):
        closed |= cells[i]
    return closed


def _numbers(mask: int) -> Iterator[int]:
    """Yield the numbers of the bits that are set, in rising order."""
    digits = bin(mask)[:1:-1]
    at = digits.find("1")
    while at >= 0:
        yield at
        at = digits.find("1", at + 1)
