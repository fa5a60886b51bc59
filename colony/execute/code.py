"""Code: the computation of all clients of a program in a frame, as straight-line scalar code.

Every backend starts from this form. `ops` is a list in static single assignment form: op i computes value i
from the frame, from memory, and from the values of earlier ops. Common ops are shared, arrays are split into
elements, reductions and loops are unrolled. All ops are total, so a backend may evaluate them in any order,
or not at all, provided that in every frame:

1. *Sensors* are read (`colony.execute.intake`) in the order of `sensors`. `SensorElement` of a missing
   sensor without default is a placeholder: an arbitrary value of its kind. Values computed from placeholders
   are never sent and never stored.
2. *Python modules* (`python`) are called in order, if their `present` is true. Ops that compute their inputs
   precede the first op that depends on a Python module.
3. *Decisions*: an actuator's winner is the first of its clients whose `guard` is true (equally: the one
   whose `exclusive` is true). Its command is `fields`. Each field is clamped to the least upper and the
   greatest lower bound among its range and its `limits` whose `applies` is true, and sent divided by its
   factor. The idle command is sent instead, unbounded, and a fault is recorded: "missing" if the winner is
   not `known`, "not finite" if a field is not finite before or after these steps, "bound missing" if a bound
   is not `known`, "limits contradict" if a lower bound is above an upper one. Without a winner the idle
   command is sent.
4. *Contracts* whose `holds` is false are broken. Only ops from `decided` on may depend on decisions.
5. *Memory*: every cell whose `condition` is true takes `value`, all at once. Until then `OldCell` is the
   value before the frame.

Times are nanoseconds since the first frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, unique
from typing import Literal as OneOf
from typing import assert_never

from colony.execute.operators import Operator
from colony.ir.program import Actuator, ActuatorField, Role, Sensor
from colony.ir.types import ScalarValue
from colony.ir.walk import InTime
from colony.text.source import Span


@unique
class Kind(Enum):
    """The kind of a value: a double, a bool, an integer in nanoseconds, or a table of numbers or bools."""

    NUMBER = "number"
    BOOL = "bool"
    TIME = "time"
    TABLE = "table"


# --- ops -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Literal:
    """A float, a bool, or (kind TIME) an int."""

    value: float | bool | int


@dataclass(frozen=True, slots=True)
class FrameTime:
    """The time of this frame, 0 in the first one."""


@dataclass(frozen=True, slots=True)
class Restarted:
    """True in the first frame after the runtime lost the program's memory."""


@dataclass(frozen=True, slots=True)
class SensorFresh:
    """True if the sensor has a reading in this frame (false if its default stands in)."""

    sensor: str


@dataclass(frozen=True, slots=True)
class SensorElement:
    """An element of a sensor's value (or default) in base units; `index` is 0 for a scalar."""

    sensor: str
    index: int


@dataclass(frozen=True, slots=True)
class OldCell:
    """The value that the cell of this index held before the frame."""

    cell: int


@dataclass(frozen=True, slots=True)
class PythonActive:
    """True if the Python module has a command in this frame.

    A module that is not in `Code.python` runs elsewhere, and its answer is an input of the frame. In the code
    of one client that is every module.
    """

    module: str


@dataclass(frozen=True, slots=True)
class PythonBlind:
    """True if the Python module has no answer in this frame (see `ir.frame.Answer`)."""

    module: str


@dataclass(frozen=True, slots=True)
class PythonField:
    """A field of the Python module's command; a placeholder where it has none."""

    module: str
    index: int


@dataclass(frozen=True, slots=True)
class Lost:
    """True if the client of this module is lost; an input of the frame (only under `on_loss degrade`)."""

    module: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table of values of one kind, for PICK_NUMBER and PICK_BOOL."""

    elements: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Apply:
    """An operator of earlier values."""

    operator: Operator
    arguments: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Winner:
    """True if the module is the actuator's winner, even if its command is not finite."""

    actuator: str
    module: str


@dataclass(frozen=True, slots=True)
class Commanded:
    """True if the winner's command was sent."""

    actuator: str


@dataclass(frozen=True, slots=True)
class Sent:
    """The value sent in a field, in base units; a placeholder where nothing was sent."""

    actuator: str
    index: int


Op = (
    Apply
    | SensorElement
    | Literal
    | OldCell
    | SensorFresh
    | FrameTime
    | Restarted
    | PythonActive
    | PythonBlind
    | PythonField
    | Lost
    | Table
    | Winner
    | Commanded
    | Sent
)


def operands(op: Op) -> tuple[int, ...]:
    """Return the operands of an op."""
    match op:
        case Apply(arguments=values) | Table(elements=values):
            return values
        case _:
            return ()


# --- structure -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A memory cell: initially `initial`; takes `value` at the end of frames in which `condition` is true.

    `name` is descriptive, and unique within a Code.
    """

    name: str
    kind: Kind
    initial: float | bool | int
    condition: int
    value: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PythonRead:
    """The input of a Python module called `name`: a scalar, or (`array`) a tuple."""

    name: str
    elements: tuple[int, ...]
    array: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class PythonCall:
    """A module whose step is Python; `fields` are those of the actuator that it commands, if any."""

    module: str
    module_path: str
    class_name: str
    params: tuple[tuple[str, ScalarValue], ...]
    present: int
    reads: tuple[PythonRead, ...]
    fields: tuple[ActuatorField, ...]
    rate_ns: int | None
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitCode:
    """A bound on a field of commands, computed once a frame.

    `known` is the condition that the bound is finite and reads nothing missing. It is constantly true where
    there is an idle command, whose value stands in.
    """

    field_index: int
    relation: OneOf["<=", ">="]
    applies: int
    bound: int
    known: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientCode:
    """A client: its command, its guards and its priority.

    All guards include `active` (the module's own activity), which, unless the module is failsafe, includes
    `present` (nothing that it reads is missing).

    Attributes:
        known: False where the module is failsafe and blind, so that it is active without a command;
            constantly true of others.
        guard, exclusive: Guards (see `colony.compile.guards`), simplified.
        loss_aware_guard, loss_aware_exclusive: Guards that its own process evaluates: under `on_loss
        degrade`,
            modules whose clients are `Lost` are not active in them.
        unsimplified: Guard before simplification, as the forward traversal gives it.
        has_several_paths: True if its command has several paths to the actuator.

    Executors read `guard` and `exclusive` of a view (`needs.py`), in which the other guards equal them.
    """

    module: str
    priority: int
    present: int
    known: int
    active: int
    guard: int
    exclusive: int
    loss_aware_guard: int
    loss_aware_exclusive: int
    unsimplified: int
    has_several_paths: bool
    fields: tuple[int, ...]
    span: Span

    @property
    def conditions(self) -> dict[str, int]:
        """The client's conditions, by name."""
        return {name: getattr(self, name) for name in _CONDITIONS}


_CONDITIONS = (
    "present",
    "known",
    "active",
    "guard",
    "exclusive",
    "loss_aware_guard",
    "loss_aware_exclusive",
    "unsimplified",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorCode:
    """An actuator with its clients, highest priority first."""

    actuator: Actuator
    clients: tuple[ClientCode, ...]
    limits: tuple[LimitCode, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContractCode:
    """A contract, broken in a frame in which `holds` is false: it is false or unknown.

    `unsimplified` is the same condition, computed with the guards before simplification. `in_time` says which
    frames are excused; None for a contract that is not `in time`. One that is `assumed` is an assumption:
    if it is broken, the program has not failed.
    """

    name: str
    holds: int
    unsimplified: int
    in_time: InTime | None = None
    assumed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Code:
    """The code of a program or of a view (see the module's docstring).

    `kinds[i]` is the kind of value i, and `names[i]` its name, if it has one. `memory_cells`
    gives the indices of cells by their names in `ir.memory`; time constants have such names only in
    unsimplified code.
    """

    ops: tuple[Op, ...]
    kinds: tuple[Kind, ...]
    decided: int
    sensors: tuple[Sensor, ...]
    cells: tuple[Cell, ...]
    python: tuple[PythonCall, ...]
    actuators: tuple[ActuatorCode, ...]
    contracts: tuple[ContractCode, ...]
    names: Mapping[int, str]
    memory_cells: Mapping[str, int] = field(default_factory=dict)


# --- liveness ------------------------------------------------------------------------------------


def roots(code: Code, *, exclusive: bool = True) -> list[int]:
    """Return the indices of the values that a frame's outcome depends on, apart from memory.

    With `exclusive`, also those that the clients' bids depend on.
    """
    indices: list[int] = []
    for call in code.python:
        indices.append(call.present)
        for read in call.reads:
            indices.extend(read.elements)
    for actuator in code.actuators:
        for client in actuator.clients:
            indices.extend((client.present, client.known, client.guard, *client.fields))
            if exclusive:
                indices.extend(client.conditions.values())
        for limit in actuator.limits:
            indices.extend((limit.applies, limit.bound, limit.known))
    for contract in code.contracts:
        indices.extend((contract.holds, contract.unsimplified))
    indices.extend(activity_read(code).values())
    return indices


def activity_read(code: Code) -> dict[str, int]:
    """Return the index of the activity that each sensor `last.MODULE is active` has in the next frame."""
    active = {c.module: c.active for a in code.actuators for c in a.clients}
    roles = {s.name: s.sent.of for s in code.sensors if s.sent is not None}
    return {
        name: active[of.module]
        for name, of in roles.items()
        if isinstance(of, Role) and of.kind == "active" and of.module in active
    }


def live(ops: Iterable[Op], cells: Iterable[Cell], wanted: Iterable[int]) -> tuple[bytearray, set[int]]:
    """Return a flag for each op that `wanted` depends on, also through memory, and the cells it depends on.

    Takes linear time.
    """
    all_ops, all_cells = tuple(ops), tuple(cells)
    flags, used_cells = bytearray(len(all_ops)), set[int]()
    work = list(wanted)
    while work:
        index = work.pop()
        if flags[index]:
            continue
        flags[index] = 1
        op = all_ops[index]
        match op:
            case Apply(arguments=values) | Table(elements=values):
                work.extend(values)
            case OldCell(cell=cell) if cell not in used_cells:
                used_cells.add(cell)
                work.extend((all_cells[cell].condition, all_cells[cell].value))
            case _:
                pass
    return flags, used_cells


def remapped(op: Op, ops: Mapping[int, int], cells: Mapping[int, int]) -> Op:
    """Return `op` with its operands and cells renumbered."""
    match op:
        case Apply(operator=operator, arguments=arguments):
            return Apply(operator, tuple([ops[i] for i in arguments]))
        case Table(elements=elements):
            return Table(tuple([ops[i] for i in elements]))
        case OldCell(cell=cell):
            return OldCell(cells[cell])
        case (
            Literal()
            | FrameTime()
            | Restarted()
            | SensorFresh()
            | SensorElement()
            | PythonActive()
            | PythonBlind()
            | PythonField()
            | Lost()
            | Winner()
            | Commanded()
            | Sent()
        ):
            return op
        case _:
            assert_never(op)
