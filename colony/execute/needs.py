"""The dependencies of each client of a program: sensors, modules in Python, memory cells.

They are computed for all clients together, with an int as a bit mask in place of each set: sets of objects
would be too slow for thousands of clients.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from colony.execute.code import (
    Code,
    OldCell,
    Op,
    PythonActive,
    PythonBlind,
    PythonField,
    SensorElement,
    SensorFresh,
    operands,
)

ClientKey = tuple[str, str]
"""Actuator and module of a client; `BOUNDS` stands for a module in the client of the actuator's bounds."""

BOUNDS = ".bounds"
"""Name of the client that computes the bounds of an actuator in each frame; no module has this name."""


class Needs(NamedTuple):
    """The dependencies of a client: names of sensors and of modules in Python, indices of cells."""

    sensors: tuple[str, ...]
    python_modules: tuple[str, ...]
    cells: tuple[int, ...]


def needs_of_clients(code: Code) -> Mapping[ClientKey, Needs]:
    """Return the dependencies of each client, including those of its limits and of its memory.

    An actuator that has limits has one more client, `BOUNDS`.

    Args:
        code: View of clients (`views.clients_view`), in which `guard` is the guard that a client evaluates
            itself. For the code of a whole program the dependencies differ.
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
        for index in operands(op):
            mask |= masks[index]
        masks.append(mask)
    cells = _cell_closure(code, masks)
    needs: dict[ClientKey, Needs] = {}
    for key, indices in _roots(code):
        mask = 0
        for index in indices:
            mask |= masks[index]
        mask = _with_memory(mask, cells)
        used = tuple(_bit_indices(mask))
        needs[key] = Needs(
            sensors=tuple([sensors[i - first_sensor] for i in used if first_sensor <= i < first_module]),
            python_modules=tuple([modules[i - first_module] for i in used if i >= first_module]),
            cells=tuple([i for i in used if i < first_sensor]),
        )
    return needs


def python_modules(code: Code) -> tuple[str, ...]:
    """Return the modules in Python whose answers the code uses."""
    called = (op.module for op in code.ops if isinstance(op, PythonActive | PythonBlind | PythonField))
    return tuple(dict.fromkeys(called))


def _source_key(op: Op) -> object:
    match op:
        case OldCell(cell=cell):
            return cell
        case SensorFresh(sensor=sensor) | SensorElement(sensor=sensor):
            return ("sensor", sensor)
        case PythonActive(module=module) | PythonBlind(module=module) | PythonField(module=module):
            return ("module", module)
        case _:
            return None


def _roots(code: Code) -> Iterator[tuple[ClientKey, tuple[int, ...]]]:
    """Yield each client with the values that it computes: its own, and those of its actuator's limits."""
    for actuator_code in code.actuators:
        name = actuator_code.actuator.name
        limits = tuple(i for x in actuator_code.limits for i in (x.applies, x.bound, x.known))
        for client in actuator_code.clients:
            yield (name, client.module), (*client.fields, *client.conditions.values(), *limits)
        if limits:
            yield (name, BOUNDS), limits


def _cell_closure(code: Code, masks: list[int]) -> list[int]:
    """Return, for each cell, itself and all that its value depends on, over any number of frames."""
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
    """Return `mask` with all that its cells depend on."""
    closed = mask
    for i in _bit_indices(mask & ((1 << len(cells)) - 1)):
        closed |= cells[i]
    return closed


def _bit_indices(mask: int) -> Iterator[int]:
    """Yield the indices of the bits that are set, in ascending order."""
    digits = bin(mask)[:1:-1]
    at = digits.find("1")
    while at >= 0:
        yield at
        at = digits.find("1", at + 1)
