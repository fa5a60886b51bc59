"""The outline of a generated `step`: its statements in order, and the values that each of them needs.

    sensors, Python modules
    for each actuator: its clients in the order of priority, then what it is sent
    contracts
    memory

Consecutive clients that need the same inputs share one test for their presence.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

from colony.compile.backends.python.layout import ROOT, Layout
from colony.compile.backends.python.placement import Placement
from colony.execute.code import ActuatorCode, ClientCode, Code, ContractCode, Literal, PythonCall, live, roots


@dataclass(frozen=True, slots=True)
class ClientPlan:
    """The slots of a client in the generated program: before its guard, and in its branch."""

    client: ClientCode
    slot: int
    body: int


@dataclass(frozen=True, slots=True)
class GroupPlan:
    """Consecutive clients with one test of `present`, which is None for a single client or a constant."""

    present: int | None
    slot: int
    clients: tuple[ClientPlan, ...]


@dataclass(frozen=True, slots=True)
class ActuatorPlan:
    """The plan of an actuator: slots before its clients, after them, and for its limits.

    `may_be_blind` is true if one of the clients is failsafe.
    """

    actuator: ActuatorCode
    slot: int
    groups: tuple[GroupPlan, ...]
    after: int
    limits: int
    may_be_blind: bool


@dataclass(frozen=True, slots=True)
class CommitPlan:
    """Cells that are updated under one condition."""

    condition: int
    slot: int
    body: int
    cells: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """The outline of the generated program: all its parts with their slots."""

    python: tuple[tuple[PythonCall, int], ...]
    actuators: tuple[ActuatorPlan, ...]
    contracts: tuple[tuple[ContractCode, int], ...]
    memory_slot: int
    commits: tuple[CommitPlan, ...]


def make_plan(code: Code, layout: Layout, placement: Placement) -> Plan:
    """Return the outline for `code`; fill `layout`, and record all uses in `placement`."""
    python = tuple((call, _python(call, layout, placement)) for call in code.python)
    actuators = tuple(_actuator(code, actuator, layout, placement) for actuator in code.actuators)
    contracts = []
    for contract in code.contracts:
        slot = layout.slot(ROOT)
        placement.use(contract.holds, slot)
        contracts.append((contract, slot))
    memory_slot = layout.slot(ROOT)
    commits = _commits(code, layout, placement)
    placement.settle(memory_slot)
    return Plan(python, actuators, tuple(contracts), memory_slot, commits)


def _python(call: PythonCall, layout: Layout, placement: Placement) -> int:
    slot = layout.slot(ROOT)
    placement.use(call.present, slot)
    for reading in call.reads:
        placement.use_all(reading.elements, slot)
    return slot


def _actuator(code: Code, actuator: ActuatorCode, layout: Layout, placement: Placement) -> ActuatorPlan:
    slot = layout.slot(ROOT)
    chain = layout.region(slot)
    reachable = _reachable(code, actuator)
    groups = [
        _group(code, list(clients), layout, placement, chain)
        for _, clients in groupby(reachable, key=lambda c: (c.present, c.known))
    ]
    after = layout.slot(ROOT)
    limits = layout.slot(layout.region(after))
    for limit in actuator.limits if groups else ():
        placement.use(limit.applies, limits, 2)
        placement.use(limit.bound, limits, 2)
        placement.use(limit.known, limits, 2)
    may_be_blind = any(_may_be_blind(code, client) for client in reachable)
    return ActuatorPlan(actuator, slot, tuple(groups), after, limits, may_be_blind)


def _may_be_blind(code: Code, client: ClientCode) -> bool:
    op = code.ops[client.known]
    return not (isinstance(op, Literal) and op.value is True)


def _reachable(code: Code, actuator: ActuatorCode) -> list[ClientCode]:
    """Return the clients that can win: those up to a constant true guard, without constant false ones."""
    reachable = []
    for client in actuator.clients:
        op = code.ops[client.guard]
        if not (isinstance(op, Literal) and op.value is False):
            reachable.append(client)
        if isinstance(op, Literal) and op.value is True:
            break
    return reachable


def _group(
    code: Code, clients: list[ClientCode], layout: Layout, placement: Placement, chain: int
) -> GroupPlan:
    slot, present = layout.slot(chain), clients[0].present
    if len(clients) == 1 or isinstance(code.ops[present], Literal) or _may_be_blind(code, clients[0]):
        plans = [_client(client, layout, placement, chain) for client in clients]
        return GroupPlan(None, slot, tuple(plans))
    placement.use(present, slot)
    region = layout.region(slot, condition=present)
    return GroupPlan(present, slot, tuple(_client(c, layout, placement, region) for c in clients))


def _client(client: ClientCode, layout: Layout, placement: Placement, region: int) -> ClientPlan:
    slot = layout.slot(region)
    placement.use(client.guard, slot)
    body = layout.slot(layout.region(slot, condition=client.guard))
    placement.use_all((client.known, *client.fields), body)
    return ClientPlan(client, slot, body)


def _commits(code: Code, layout: Layout, placement: Placement) -> tuple[CommitPlan, ...]:
    """Return the updates of the cells in use; this backend does not use exclusive guards."""
    _, used_cells = live(code.ops, code.cells, roots(code, exclusive=False))
    cells_by_condition: dict[int, list[int]] = {}
    for cell in sorted(used_cells):
        cells_by_condition.setdefault(code.cells[cell].condition, []).append(cell)
    commits = []
    for condition, cells in cells_by_condition.items():
        slot = layout.slot(ROOT)
        placement.use(condition, slot)
        body = layout.slot(layout.region(slot, condition=condition))
        placement.use_all((code.cells[cell].value for cell in cells), body)
        commits.append(CommitPlan(condition, slot, body, tuple(cells)))
    return tuple(commits)
