"""The dependencies of each client of a program: sensors, modules in Python, memory cells.

They are computed for all clients together, with an int as a bit mask in place of each set: sets of objects
would be too slow for thousands of clients.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from colony.execute.code import (
    ActuatorCode,
    ClientCode,
    Code,
    ContractCode,
    OldCell,
    Op,
    PythonActive,
    PythonBlind,
    PythonCall,
    PythonField,
    SensorElement,
    SensorFresh,
    live,
    operands,
    remapped,
    roots,
)
from colony.ir.program import Sensor, sensors_in_base_units

ClientKey = tuple[str, str]
"""Actuator and module of a client; `BOUNDS` stands for a module in the client of the actuator's bounds."""

BOUNDS = ".bounds"
"""Name of the client that computes the bounds of an actuator in each frame; no module has this name."""


class ClientNeeds(NamedTuple):
    """The dependencies of a client: names of sensors and of modules in Python, indices of cells."""

    sensors: tuple[str, ...]
    python_modules: tuple[str, ...]
    cells: tuple[int, ...]


def needs_of_clients(code: Code) -> Mapping[ClientKey, ClientNeeds]:
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
    needs: dict[ClientKey, ClientNeeds] = {}
    for key, indices in _roots(code):
        mask = 0
        for index in indices:
            mask |= masks[index]
        mask = _with_memory(mask, cells)
        used = tuple(_bit_indices(mask))
        needs[key] = ClientNeeds(
            sensors=tuple([sensors[i - first_sensor] for i in used if first_sensor <= i < first_module]),
            python_modules=tuple([modules[i - first_module] for i in used if i >= first_module]),
            cells=tuple([i for i in used if i < first_sensor]),
        )
    return needs


def sensors_without_default(code: Code) -> dict[ClientKey, tuple[Sensor, ...]]:
    """Return, by client, the sensors that it reads and that are missing where no server gives a value.

    Those with a default are not, nor is what an executor knows of its own last frame.
    """
    may_miss = {s.name: s for s in code.sensors if s.default is None and s.sent is None}
    return {
        key: tuple(may_miss[name] for name in needs.sensors if name in may_miss)
        for key, needs in needs_of_clients(code).items()
    }


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


# --- views --------------------------------------------------------------------------------------------
#
# Views of a program's code: the part of its table of operations that an executor needs.
#
# A view is a separate `Code`, renumbered and without dead ops. It is made in one pass.


def whole_view(code: Code) -> Code:
    """Return the view of all clients with their simplified guards."""
    return _view_of_all(code, code.contracts, lambda c: (c.guard, c.exclusive))


def loss_aware_view(code: Code) -> Code:
    """Return the view of all clients with the guards that their own processes evaluate."""
    return _view_of_all(code, code.contracts, lambda c: (c.loss_aware_guard, c.loss_aware_exclusive))


def unsimplified_view(code: Code) -> Code:
    """Return the view of all clients with their guards before simplification.

    Its `memory_cells` are complete.
    """
    contracts = tuple(replace(contract, holds=contract.unsimplified) for contract in code.contracts)
    return _view_of_all(code, contracts, lambda c: (c.unsimplified, c.exclusive))


def clients_view(code: Code, clients: Collection[tuple[str, str]]) -> Code:
    """Return the view of some clients, by actuator and module; `BOUNDS` for a module is its limits alone.

    The view has the guards that the clients' own process evaluates, their commands, and the limits on the
    commands. Sensors are in base units. Modules in Python run elsewhere, even those of the clients.

    Raises:
        KeyError: there is no such client.
    """
    remaining = set(clients)
    actuators = []
    for actuator_code in code.actuators:
        name = actuator_code.actuator.name
        own = tuple(c for c in actuator_code.clients if (name, c.module) in remaining)
        is_bounded = bool(actuator_code.limits) and (name, BOUNDS) in remaining
        remaining.difference_update((name, c.module) for c in own)
        remaining.difference_update([(name, BOUNDS)] if is_bounded else ())
        if own or is_bounded:
            loss_aware_clients = tuple(
                _with_guards(c, c.loss_aware_guard, c.loss_aware_exclusive) for c in own
            )
            actuators.append(replace(actuator_code, clients=loss_aware_clients))
    if remaining:
        raise KeyError(min(remaining))
    view = replace(
        code,
        sensors=sensors_in_base_units(code.sensors),
        python=(),
        actuators=tuple(actuators),
        contracts=(),
    )
    return trimmed(view, every_sensor=False)


def module_view(code: Code, module: str) -> Code:
    """Return the view of a module in Python: its inputs, computed from sensors in base units.

    Raises:
        KeyError: there is no such module.
    """
    call = {call.module: call for call in code.python}[module]
    view = replace(
        code, sensors=sensors_in_base_units(code.sensors), python=(call,), actuators=(), contracts=()
    )
    return trimmed(view, every_sensor=False)


def _view_of_all(
    code: Code, contracts: tuple[ContractCode, ...], guards: Callable[[ClientCode], tuple[int, int]]
) -> Code:
    actuators = tuple(
        replace(actuator_code, clients=tuple(_with_guards(c, *guards(c)) for c in actuator_code.clients))
        for actuator_code in code.actuators
    )
    contracts = tuple(replace(contract, unsimplified=contract.holds) for contract in contracts)
    return trimmed(replace(code, actuators=actuators, contracts=contracts), every_sensor=True)


def _with_guards(client: ClientCode, guard: int, exclusive: int) -> ClientCode:
    return replace(
        client,
        guard=guard,
        exclusive=exclusive,
        loss_aware_guard=guard,
        loss_aware_exclusive=exclusive,
        unsimplified=guard,
    )


def trimmed(code: Code, *, every_sensor: bool) -> Code:
    """Return `code` without dead ops and cells and, unless `every_sensor`, without unused sensors."""
    flags, used_cells = live(code.ops, code.cells, roots(code))
    precedes = before_decisions(code)
    kept = sorted((i for i, flag in enumerate(flags) if flag), key=lambda i: (not precedes[i], i))
    new_index = {old: new for new, old in enumerate(kept)}
    new_cell = {old: new for new, old in enumerate(sorted(used_cells))}
    ops = tuple(remapped(code.ops[i], new_index, new_cell) for i in kept)
    used_sensors = {op.sensor for op in ops if isinstance(op, SensorFresh | SensorElement)}
    return Code(
        ops=ops,
        kinds=tuple(code.kinds[i] for i in kept),
        decided=sum(precedes[i] for i in kept),
        sensors=tuple(s for s in code.sensors if every_sensor or s.name in used_sensors),
        cells=tuple(
            replace(c, condition=new_index[c.condition], value=new_index[c.value])
            for c in (code.cells[i] for i in new_cell)
        ),
        python=tuple(_python(call, new_index) for call in code.python),
        actuators=tuple(_actuator(actuator, new_index) for actuator in code.actuators),
        contracts=tuple(
            replace(c, holds=new_index[c.holds], unsimplified=new_index[c.unsimplified])
            for c in code.contracts
        ),
        names={new_index[i]: name for i, name in code.names.items() if i in new_index},
        memory_cells={name: new_cell[i] for name, i in code.memory_cells.items() if i in new_cell},
    )


def before_decisions(code: Code) -> bytearray:
    """Return a flag for each op that must precede decisions: it does already, or a client depends on it."""
    flags = bytearray(len(code.ops))
    flags[: code.decided] = b"\1" * code.decided
    for actuator_code in code.actuators:
        for client in actuator_code.clients:
            for index in client.conditions.values():
                flags[index] = 1
    for index in range(len(code.ops) - 1, -1, -1):
        if flags[index]:
            for operand in operands(code.ops[index]):
                flags[operand] = 1
    return flags


def _python(call: PythonCall, new_index: dict[int, int]) -> PythonCall:
    reads = tuple(replace(r, elements=tuple([new_index[i] for i in r.elements])) for r in call.reads)
    return replace(call, present=new_index[call.present], reads=reads)


def _actuator(actuator_code: ActuatorCode, new_index: dict[int, int]) -> ActuatorCode:
    return replace(
        actuator_code,
        clients=tuple(_client(client, new_index) for client in actuator_code.clients),
        limits=tuple(
            replace(x, applies=new_index[x.applies], bound=new_index[x.bound], known=new_index[x.known])
            for x in actuator_code.limits
        ),
    )


def _client(client: ClientCode, new_index: dict[int, int]) -> ClientCode:
    conditions: dict[str, Any] = {name: new_index[index] for name, index in client.conditions.items()}
    return replace(client, fields=tuple([new_index[i] for i in client.fields]), **conditions)
