"""The outline of a generated `step`: its statements in order, and the values that each of them needs.

    sensors, Python modules
    for each actuator: its clients in the order of priority, then what it is sent
    contracts
    memory

Consecutive clients that need the same inputs share one test for their presence.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import groupby

from colony.compile.backends.python.text import NumberRange, mentions_twice
from colony.execute.code import (
    ActuatorCode,
    Apply,
    ClientCode,
    Code,
    ContractCode,
    Literal,
    OldCell,
    Op,
    PythonCall,
    Table,
    activity_read,
    live,
    operands,
    roots,
)

# --- layout -------------------------------------------------------------------------------------------
#
# The layout of a generated program: the slots at which values can be computed.
#
# A program is a tree of regions: the body of the function, its blocks, and their branches. A region has slots
# in text order, and each statement that uses values has a slot before it, where those values can be computed.
# A value that is used several times is computed once, at the last slot that precedes and dominates every use:
# in the innermost region around all uses, before the first of them.

ROOT = 0


@dataclass(slots=True)
class FunctionLayout:
    """The regions and slots of one function, numbered in text order. Mutable."""

    _parent_slot: list[int] = field(default_factory=lambda: [-1])  # by region
    _depth: list[int] = field(default_factory=lambda: [0])  # by region
    _region: list[int] = field(default_factory=list)  # by slot
    _true_values: list[frozenset[int]] = field(default_factory=lambda: [frozenset()])  # by region

    def slot(self, region: int) -> int:
        """Return a new slot at the end of the text so far, in `region`."""
        self._region.append(region)
        return len(self._region) - 1

    def region(self, slot: int, condition: int | None = None) -> int:
        """Return a new region after `slot`, which is entered only if the value `condition` is true."""
        outer = self._region[slot]
        self._parent_slot.append(slot)
        self._depth.append(self._depth[outer] + 1)
        inherited = self._true_values[outer]
        self._true_values.append(inherited if condition is None else inherited | {condition})
        return len(self._parent_slot) - 1

    def true_values_at(self, slot: int) -> frozenset[int]:
        """Return conditions that are true whenever `slot` is reached."""
        return self._true_values[self._region[slot]]

    def join(self, a: int, b: int) -> int:
        """Return the last slot that precedes and dominates both `a` and `b`."""
        regions, parents, depths = self._region, self._parent_slot, self._depth
        while regions[a] != regions[b]:
            if depths[regions[a]] >= depths[regions[b]]:
                a = parents[regions[a]]
            else:
                b = parents[regions[b]]
        return min(a, b)


# --- placement ----------------------------------------------------------------------------------------
#
# Decides which values of a `Code` get a variable in a generated program, and where they are computed.


def is_atom(op: Op) -> bool:
    """Return True if the value's text is a variable or constant anyway."""
    return not isinstance(op, Apply | OldCell | Table)


class Placement:
    """The slots at which values are computed. Mutable: filled by `use`, completed by `settle`.

    Then `uses` holds the number of uses of each value, and `slot` where it is computed; `named` is true
    if it is assigned to a variable there, false if it is an expression at its use.
    """

    def __init__(self, code: Code, layout: FunctionLayout, ranges: list[NumberRange]) -> None:
        self.code = code
        self.layout = layout
        self._ranges = ranges
        self.uses = [0] * len(code.ops)
        self.slot = [-1] * len(code.ops)
        self.named = bytearray(len(code.ops))

    def use(self, value: int, slot: int, times: int = 1) -> None:
        """Record that the statement after `slot` uses `value` `times` times."""
        self.slot[value] = slot if self.uses[value] == 0 else self.layout.join(self.slot[value], slot)
        self.uses[value] += times

    def use_all(self, values: Iterable[int], slot: int) -> None:
        """Record that the statement after `slot` uses each of `values` once."""
        for value in values:
            self.use(value, slot)

    def settle(self, memory_slot: int) -> None:
        """Decide for every value, from the last to the first, since a value comes after its operands.

        Memory is updated after `memory_slot`, so old values of cells are read there at the latest.
        """
        for value in reversed(range(len(self.code.ops))):
            if not self.uses[value]:
                continue
            op = self.code.ops[value]
            if isinstance(op, OldCell) and self.slot[value] >= memory_slot:
                self.slot[value], self.named[value] = memory_slot, True
            if self.uses[value] > 1 and not is_atom(op):
                self.named[value] = True
            mentioned_twice = isinstance(op, Apply) and mentions_twice(
                op.operator, [self._ranges[i] for i in op.arguments]
            )
            for operand in operands(op):
                self.use(operand, self.slot[value], 2 if mentioned_twice else 1)


# --- plan ---------------------------------------------------------------------------------------------


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
class ProgramOutline:
    """The outline of the generated program: all its parts with their slots.

    `activity` is what sensors `last.MODULE is active` have in the next frame.
    """

    python: tuple[tuple[PythonCall, int], ...]
    actuators: tuple[ActuatorPlan, ...]
    contracts: tuple[tuple[ContractCode, int], ...]
    activity: tuple[tuple[str, int], ...]
    activity_slot: int
    memory_slot: int
    commits: tuple[CommitPlan, ...]


def make_plan(
    code: Code, layout: FunctionLayout, placement: Placement, *, grouped: bool = True
) -> ProgramOutline:
    """Return the outline for `code`; fill `layout`, and record all uses in `placement`.

    Unless `grouped`, each client is a group: its guard then has the structure that the proof expects.
    """
    python = tuple((call, _python(call, layout, placement)) for call in code.python)
    actuators = tuple(_actuator(code, actuator, layout, placement, grouped) for actuator in code.actuators)
    contracts = []
    for contract in code.contracts:
        slot = layout.slot(ROOT)
        placement.use(contract.holds, slot)
        contracts.append((contract, slot))
    activity, activity_slot = activity_read(code), layout.slot(ROOT)
    placement.use_all(activity.values(), activity_slot)
    memory_slot = layout.slot(ROOT)
    commits = _commits(code, layout, placement)
    placement.settle(memory_slot)
    return ProgramOutline(
        python, actuators, tuple(contracts), tuple(activity.items()), activity_slot, memory_slot, commits
    )


def _python(call: PythonCall, layout: FunctionLayout, placement: Placement) -> int:
    slot = layout.slot(ROOT)
    placement.use(call.present, slot)
    for reading in call.reads:
        placement.use_all(reading.elements, slot)
    return slot


def _actuator(
    code: Code, actuator: ActuatorCode, layout: FunctionLayout, placement: Placement, grouped: bool
) -> ActuatorPlan:
    slot = layout.slot(ROOT)
    chain = layout.region(slot)
    reachable = _reachable(code, actuator)
    groups = [
        _group(code, list(clients), layout, placement, chain)
        for _, clients in groupby(reachable, key=lambda c: (c.present, c.known) if grouped else c.module)
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
    code: Code, clients: list[ClientCode], layout: FunctionLayout, placement: Placement, chain: int
) -> GroupPlan:
    slot, present = layout.slot(chain), clients[0].present
    if len(clients) == 1 or isinstance(code.ops[present], Literal) or _may_be_blind(code, clients[0]):
        plans = [_client(client, layout, placement, chain) for client in clients]
        return GroupPlan(None, slot, tuple(plans))
    placement.use(present, slot)
    region = layout.region(slot, condition=present)
    return GroupPlan(present, slot, tuple(_client(c, layout, placement, region) for c in clients))


def _client(client: ClientCode, layout: FunctionLayout, placement: Placement, region: int) -> ClientPlan:
    slot = layout.slot(region)
    placement.use(client.guard, slot)
    body = layout.slot(layout.region(slot, condition=client.guard))
    placement.use_all((client.known, *client.fields), body)
    return ClientPlan(client, slot, body)


def _commits(code: Code, layout: FunctionLayout, placement: Placement) -> tuple[CommitPlan, ...]:
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
