"""Views of a program's code: the part of its table of operations that an executor needs.

A view is a `Code` of its own, renumbered and without dead ops, made in one pass.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from colony.execute.code import (
    ActuatorCode,
    ClientCode,
    Code,
    ContractCode,
    PythonCall,
    SensorElement,
    SensorFresh,
    live,
    operands,
    remapped,
    roots,
)
from colony.ir.program import sensors_in_base_units


def whole(code: Code) -> Code:
    """Return the view of all clients with their simplified guards."""
    return _of_all(code, code.contracts, lambda c: (c.guard, c.exclusive))


def heard(code: Code) -> Code:
    """Return the view of all clients with the guards that their own processes evaluate."""
    return _of_all(code, code.contracts, lambda c: (c.heard_guard, c.heard_exclusive))


def unsimplified(code: Code) -> Code:
    """Return the view of all clients with their guards before simplification; its memory has all places."""
    contracts = tuple(replace(contract, value=contract.traversed) for contract in code.contracts)
    return _of_all(code, contracts, lambda c: (c.traversed, c.exclusive))


def of_clients(code: Code, clients: Collection[tuple[str, str]]) -> Code:
    """Return the view of some clients, by actuator and module.

    The view has the guards that their own process evaluates, their commands, and the limits on these. Sensors
    are in base units. Modules in Python run elsewhere, even those of the clients.

    Raises:
        KeyError: there is no such client.
    """
    left = set(clients)
    actuators = []
    for actuator_code in code.actuators:
        own = tuple(c for c in actuator_code.clients if (actuator_code.actuator.name, c.module) in left)
        left.difference_update((actuator_code.actuator.name, c.module) for c in own)
        if own:
            heard = tuple(_decided_by(c, c.heard_guard, c.heard_exclusive) for c in own)
            actuators.append(replace(actuator_code, clients=heard))
    if left:
        raise KeyError(min(left))
    view = replace(
        code,
        sensors=sensors_in_base_units(code.sensors),
        python=(),
        actuators=tuple(actuators),
        contracts=(),
    )
    return trimmed(view, every_sensor=False)


def of_module(code: Code, module: str) -> Code:
    """Return the view of a module in Python: its inputs, computed from sensors in base units.

    Raises:
        KeyError: there is no such module.
    """
    call = {call.module: call for call in code.python}[module]
    view = replace(
        code, sensors=sensors_in_base_units(code.sensors), python=(call,), actuators=(), contracts=()
    )
    return trimmed(view, every_sensor=False)


def _of_all(
    code: Code, contracts: tuple[ContractCode, ...], guards: Callable[[ClientCode], tuple[int, int]]
) -> Code:
    actuators = tuple(
        replace(actuator_code, clients=tuple(_decided_by(c, *guards(c)) for c in actuator_code.clients))
        for actuator_code in code.actuators
    )
    contracts = tuple(replace(contract, traversed=contract.value) for contract in contracts)
    return trimmed(replace(code, actuators=actuators, contracts=contracts), every_sensor=True)


def _decided_by(client: ClientCode, guard: int, exclusive: int) -> ClientCode:
    return replace(
        client,
        guard=guard,
        exclusive=exclusive,
        heard_guard=guard,
        heard_exclusive=exclusive,
        traversed=guard,
    )


def trimmed(code: Code, *, every_sensor: bool) -> Code:
    """Return `code` without dead ops and cells and, unless `every_sensor`, without unused sensors."""
    flags, used_cells = live(code.ops, code.cells, roots(code))
    first = before_decisions(code)
    kept = sorted((i for i, flag in enumerate(flags) if flag), key=lambda i: (not first[i], i))
    number = {old: new for new, old in enumerate(kept)}
    cell_number = {old: new for new, old in enumerate(sorted(used_cells))}
    ops = tuple(remapped(code.ops[i], number, cell_number) for i in kept)
    read = {op.sensor for op in ops if isinstance(op, SensorFresh | SensorElement)}
    return Code(
        ops=ops,
        kinds=tuple(code.kinds[i] for i in kept),
        decided=sum(first[i] for i in kept),
        sensors=tuple(s for s in code.sensors if every_sensor or s.name in read),
        cells=tuple(
            replace(c, condition=number[c.condition], value=number[c.value])
            for c in (code.cells[i] for i in cell_number)
        ),
        python=tuple(_python(call, number) for call in code.python),
        actuators=tuple(_actuator(actuator, number) for actuator in code.actuators),
        contracts=tuple(
            replace(c, present=number[c.present], value=number[c.value], traversed=number[c.traversed])
            for c in code.contracts
        ),
        names={number[i]: name for i, name in code.names.items() if i in number},
        places={name: cell_number[i] for name, i in code.places.items() if i in cell_number},
    )


def before_decisions(code: Code) -> bytearray:
    """Return a flag for each op that must precede decisions: it stands there, or a client depends on it."""
    flags = bytearray(len(code.ops))
    flags[: code.decided] = b"\1" * code.decided
    for actuator_code in code.actuators:
        for client in actuator_code.clients:
            for at in client.conditions.values():
                flags[at] = 1
    for at in range(len(code.ops) - 1, -1, -1):
        if flags[at]:
            for operand in operands(code.ops[at]):
                flags[operand] = 1
    return flags


def _python(call: PythonCall, number: dict[int, int]) -> PythonCall:
    reads = tuple(replace(r, elements=tuple([number[i] for i in r.elements])) for r in call.reads)
    return replace(call, present=number[call.present], reads=reads)


def _actuator(actuator_code: ActuatorCode, number: dict[int, int]) -> ActuatorCode:
    return replace(
        actuator_code,
        clients=tuple(_client(client, number) for client in actuator_code.clients),
        limits=tuple(
            replace(x, applies=number[x.applies], bound=number[x.bound]) for x in actuator_code.limits
        ),
    )


def _client(client: ClientCode, number: dict[int, int]) -> ClientCode:
    conditions: dict[str, Any] = {name: number[at] for name, at in client.conditions.items()}
    return replace(client, fields=tuple([number[i] for i in client.fields]), **conditions)
