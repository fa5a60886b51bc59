"""Plain executors of a compiled program, of some of its clients, or of one module in Python.

They run op by op; the code generated from the same `Code` (`colony.compile.backends`) is faster.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

from colony.execute.code import (
    ActuatorCode,
    ClientCode,
    Commanded,
    Kind,
    OldCell,
    PythonActive,
    PythonBlind,
    PythonField,
    Sent,
    Winner,
    operands,
)
from colony.execute.compiled import Compiled
from colony.execute.decisions import ActuatorDecision, BoundsStep, bounds_in_frame, decide, decide_given
from colony.execute.machine import OpMachine
from colony.execute.needs import (
    BOUNDS,
    ClientKey,
    clients_view,
    module_view,
    needs_of_clients,
    python_modules,
    unsimplified_view,
    whole_view,
)
from colony.ir.frame import (
    NOTHING_GIVEN,
    Answer,
    Bid,
    Decision,
    Frame,
    FrameEvent,
    Outcome,
    OverriddenCommand,
)
from colony.ir.memory import ProgramMemory, late_cell
from colony.ir.program import Actuator, in_declared_units, value_before
from colony.ir.types import ScalarValue
from colony.ir.walk import idled, remembered


class ExclusivityError(Exception):
    """Two exclusive guards of one actuator were true in a frame: a bug in the compiler."""


class ProgramExecutor:
    """An executor of all clients of a program (see `ir.frame.Executor`). Stateful: holds all memory.

    Args:
        compiled: The program.
        exclusive: If true, the winner is the client whose exclusive guard holds; if false, the first client
            whose guard holds.
        simplified: If false, the guards before simplification decide. They do not depend on the last pass,
            and with them `memory` includes the time constants.
        answers_given: If true, modules in Python run elsewhere, and `step` takes their answers.

    Raises:
        DiagnosticError: a Python module's class cannot be imported or built.
        ExclusivityError: in `step`, if `exclusive`, and more than one guard holds.
    """

    def __init__(
        self,
        compiled: Compiled,
        *,
        exclusive: bool = False,
        simplified: bool = True,
        answers_given: bool = False,
    ) -> None:
        self.code = whole_view(compiled.code) if simplified else unsimplified_view(compiled.code)
        self._exclusive, self._answers_given = exclusive, answers_given
        self._remembered = remembered(c.in_time for c in self.code.contracts)
        self._sent = tuple((s.name, s.sent) for s in self.code.sensors if s.sent is not None)
        self._active = {c.module: c.active for a in self.code.actuators for c in a.clients}
        self.restart()

    def step(
        self,
        frame: Frame,
        answers: Mapping[str, Answer] | None = None,
        given: Mapping[str, OverriddenCommand] = NOTHING_GIVEN,
    ) -> Outcome:
        """Execute one frame; return the decision for each actuator, the records and the broken contracts.

        `given` is what actuators were given, by actuator, where that is not what the network decided.
        """
        machine, code = self._machine, self.code
        if self._sent:
            frame = frame._replace(readings={**self._last, **frame.readings})
        machine.begin(frame, answers)
        machine.run()
        decisions = tuple(self._decide(actuator, given) for actuator in code.actuators)
        machine.run_after_decisions()
        values = machine.values
        late = idled(given)
        self._late |= late & self._remembered
        breaches = tuple(
            c.name
            for c in code.contracts
            if not values[c.holds] and not (c.in_time and c.in_time.excuses(late, self._late))
        )
        machine.commit()
        if self._sent:
            self._remember_sent(decisions)
        return Outcome(decisions, machine.records(), breaches)

    def advance(self, frame: Frame, answers: Mapping[str, Answer], missing: Collection[str]) -> bool:
        """Step over a frame in which the answers of the modules `missing` are not known.

        Call it for the frames that follow, too, until it returns True.

        Returns:
            True if memory is known: no cell has a value that depends on an answer that was missing.
        """
        doubtful = self._doubtful(missing)
        self.step(frame, {**answers, **{module: Answer(blind=True) for module in missing}})
        values, doubted = self._machine.values, self._doubted_cells
        for i, cell in enumerate(self.code.cells):
            if doubtful[cell.condition] or (values[cell.condition] and doubtful[cell.value]):
                doubted.add(i)
            elif values[cell.condition]:
                doubted.discard(i)
        return not doubted

    def _doubtful(self, missing: Collection[str]) -> list[bool]:
        """Return for each value whether it depends on a missing answer, of this frame or through memory."""
        is_any, doubtful = bool(missing or self._doubted_cells), list[bool]()
        for op in self.code.ops:
            match op:
                case PythonActive(module=module) | PythonBlind(module=module) | PythonField(module=module):
                    doubtful.append(module in missing)
                case OldCell(cell=cell):
                    doubtful.append(cell in self._doubted_cells)
                case Winner() | Commanded() | Sent():
                    doubtful.append(is_any)
                case _:
                    doubtful.append(any(doubtful[i] for i in operands(op)))
        return doubtful

    def network_decisions(self) -> tuple[Decision, ...]:
        """Return what the network decided in the last frame, whatever actuators were given."""
        values = self._machine.values
        return tuple(_declared(a.actuator, decide(a, self._winner(a), values)) for a in self.code.actuators)

    def bounds(self) -> dict[str, BoundsStep]:
        """Return the bounds of each actuator's fields in the last frame, in base units."""
        values = self._machine.values
        return {a.actuator.name: bounds_in_frame(a, values) for a in self.code.actuators}

    def restart(self) -> None:
        """Restart from the initial memory, with new instances of the Python modules.

        Raises:
            DiagnosticError: one of them cannot be built.
        """
        self._machine = OpMachine(self.code, answers_given=self._answers_given)
        self._doubted_cells: set[int] = set()
        self._last: dict[str, ScalarValue] = {}  # values of `last...`, in declared units
        self._late: set[str] = set()  # actuators of `_remembered` that were idle as a client was late

    def _remember_sent(self, decisions: tuple[Decision, ...]) -> None:
        """Remember what is `last...` in the next frame, unless a reading says otherwise."""
        by_name = {decision.actuator: decision for decision in decisions}
        for name, before in self._sent:
            decision = by_name[before.actuator]
            value = value_before(before.of, decision.values, decision.by, self._was_active)
            if value is not None:
                self._last[name] = value

    def _was_active(self, module: str) -> bool:
        return module in self._active and bool(self._machine.values[self._active[module]])

    @property
    def memory(self) -> ProgramMemory | None:
        """The program's memory, complete only with unsimplified guards.

        None if the executor runs modules in Python, which keep their own memory.
        """
        machine = self._machine
        if machine.python:
            return None
        cells = {name: machine.cells[i] for name, i in self.code.memory_cells.items()}
        cells |= {late_cell(actuator): actuator in self._late for actuator in sorted(self._remembered)}
        return ProgramMemory(first_ns=machine.first_ns, cells=cells, last=dict(self._last))

    def resume(self, memory: ProgramMemory) -> None:
        """Continue from the memory of another executor.

        Raises:
            ValueError: it is not the memory of this program: its cells or their types differ.
        """
        memory_cells = self.code.memory_cells
        late_cells = {late_cell(actuator): actuator for actuator in self._remembered}
        if self._machine.python or memory.cells.keys() != memory_cells.keys() | late_cells.keys():
            raise ValueError("the memory is of another program")
        cells = self.code.cells
        restored = {i: _restored(name, cells[i].kind, memory.cells[name]) for name, i in memory_cells.items()}
        self.restart()
        for i, value in restored.items():
            self._machine.cells[i] = value
        self._machine.first_ns = memory.first_ns
        self._last = dict(memory.last)
        self._late = {actuator for name, actuator in late_cells.items() if memory.cells[name]}

    def _decide(self, actuator: ActuatorCode, given: Mapping[str, OverriddenCommand]) -> Decision:
        winner = self._winner(actuator)
        if actuator.actuator.name in given:
            decided = decide_given(actuator, given[actuator.actuator.name], self._machine.values)
        else:
            decided = decide(actuator, winner, self._machine.values)
        self._machine.record_decision(actuator.actuator.name, decided)
        return _declared(actuator.actuator, decided)

    def _winner(self, actuator: ActuatorCode) -> ClientCode | None:
        values = self._machine.values
        if not self._exclusive:
            return next((c for c in actuator.clients if values[c.guard]), None)
        holding = [c for c in actuator.clients if values[c.exclusive]]
        if len(holding) > 1:
            raise ExclusivityError(f"{actuator.actuator.name}: {', '.join(c.module for c in holding)}")
        return holding[0] if holding else None


def _declared(actuator: Actuator, decided: ActuatorDecision) -> Decision:
    """Return a decision in declared units."""
    values = in_declared_units(decided.sent, actuator.fields)
    return Decision(actuator.name, decided.by, values, decided.fault)


# --- clients ---------------------------------------------------------------------------------


class ClientStep(NamedTuple):
    """A client's message to its server in a frame.

    Attributes:
        active: True if it requests that its command be sent.
        values: Command in base units within limits and range; None unless active, and with a fault, in
            which case the actuator gets its idle command.
        fault: "missing", "not finite", "bound missing" or "limits contradict" where the command cannot be
            sent.
        records: Records of all sensors that the executor reads, and of this client's command.
        bid: "command" if active, else the reason (see `ir.frame.Bid`). A client that is both suppressed and
            inhibited is "inhibited". A client whose command has several paths to the actuator, all of them
            closed, is "suppressed".
    """

    active: bool
    values: tuple[ScalarValue, ...] | None
    fault: str | None
    records: tuple[FrameEvent, ...]
    bid: Bid


class ClientMemory(NamedTuple):
    """Memory cells that belong to a client (see `ClientsExecutor.memory`), as plain data.

    `first_ns` is the time of the first frame, None before it; `cells` are by name.
    """

    first_ns: int | None
    cells: dict[str, float | bool | int]


class ClientsExecutor:
    """An executor of some clients of a program. Stateful: holds their memory.

    Values that several clients need are computed once. Frames are in base units. Modules in Python run
    elsewhere, even if they are clients.

    Args:
        compiled: The program.
        clients: Actuator and module of each client; `needs.BOUNDS` in place of the module for the client of
            an actuator's bounds.

    Raises:
        KeyError: there is no such client.
    """

    def __init__(self, compiled: Compiled, clients: Iterable[ClientKey]) -> None:
        self.keys = keys = tuple(sorted(clients, key=lambda key: key[1] == BOUNDS))
        self.clients = tuple(key for key in keys if key[1] != BOUNDS)
        self.bounded = tuple(actuator for actuator, module in keys if module == BOUNDS)
        self.code = clients_view(compiled.code, keys)
        by_key = {(a.actuator.name, c.module): (a, c) for a in self.code.actuators for c in a.clients}
        self._codes = tuple(by_key[key] for key in self.clients)
        by_name = {a.actuator.name: a for a in self.code.actuators}
        self._bounded_codes = tuple(by_name[actuator] for actuator in self.bounded)
        self._cells = self._own_cells()
        self.restart()

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that the clients read."""
        return tuple(s.name for s in self.code.sensors)

    @property
    def python_modules(self) -> tuple[str, ...]:
        """The modules in Python whose answers `step` needs."""
        return python_modules(self.code)

    def step(
        self, frame: Frame, answers: Mapping[str, Answer] | None = None, lost: frozenset[str] = frozenset()
    ) -> tuple[ClientStep, ...]:
        """Execute one frame, given the answers of modules in Python and the modules whose clients are lost.

        Returns:
            The message of each client to its server, in the order of `clients`.

        Raises:
            KeyError: `answers` lacks one of `python_modules`.
        """
        machine = self._machine
        machine.begin(frame, answers, lost)
        machine.run(decides=False)
        records, values = machine.records(), machine.values
        machine.commit()
        return tuple([_client_step(actuator, c, values, records) for actuator, c in self._codes])

    def bounds(self) -> tuple[BoundsStep, ...]:
        """Return the bounds of each actuator of `bounded` in the last frame."""
        return tuple([bounds_in_frame(actuator, self._machine.values) for actuator in self._bounded_codes])

    def restart(self) -> None:
        """Restart from the initial memory."""
        self._machine = OpMachine(self.code)

    def memory(self, client: ClientKey) -> ClientMemory:
        """Return a copy of the memory cells that belong to a client.

        A cell belongs to the first of `clients` that needs it. So all memories together are the executor's
        memory, but one alone may not be all that its client needs.
        """
        machine, cells = self._machine, self.code.cells
        return ClientMemory(machine.first_ns, {cells[i].name: machine.cells[i] for i in self._cells[client]})

    def recall(self, memories: Mapping[ClientKey, ClientMemory]) -> None:
        """Continue from the memories of all clients after the same frame.

        Raises:
            ValueError: they are not: their cells, the types of their cells, or the times of their first
                frames differ.
        """
        if memories.keys() != self._cells.keys():
            raise ValueError("the memories are not of these clients")
        for client, indices in self._cells.items():
            if memories[client].cells.keys() != {self.code.cells[i].name for i in indices}:
                raise ValueError("the memory is of another client")
        known = {name: value for memory in memories.values() for name, value in memory.cells.items()}
        restored = [_restored(c.name, c.kind, known[c.name]) for c in self.code.cells]
        first_ns, *others = {memory.first_ns for memory in memories.values()}
        if others:
            raise ValueError("the memories are of different runs")
        self._machine.first_ns, self._machine.cells = first_ns, restored

    def _own_cells(self) -> dict[ClientKey, list[int]]:
        """Return the cells of each client; a cell belongs to the first client that needs it."""
        needs, shared = needs_of_clients(self.code), set[int]()
        own_cells: dict[ClientKey, list[int]] = {}
        for client in self.keys:
            own_cells[client] = [i for i in needs[client].cells if i not in shared]
            shared.update(own_cells[client])
        return own_cells


def _client_step(
    actuator: ActuatorCode, client: ClientCode, values: list[Any], records: tuple[FrameEvent, ...]
) -> ClientStep:
    won = bool(values[client.exclusive])
    decided = decide(actuator, client if won else None, values)
    own = tuple(FrameEvent(kind, subject) for kind, subject in decided.records)  # type: ignore[arg-type]
    sent = decided.sent if won and decided.fault is None else None
    return ClientStep(won, sent, decided.fault, records + own, _bid(client, values))


def _bid(client: ClientCode, values: list[Any]) -> Bid:
    if values[client.exclusive]:
        return "command"
    if not values[client.active]:
        return "inactive" if values[client.present] else "silent"
    return "suppressed" if values[client.guard] or client.has_several_paths else "inhibited"


class ModuleExecutor:
    """An executor of one module in Python. Stateful: holds the memory of its inputs, and the module.

    Frames are in base units.

    Raises:
        KeyError: there is no such module.
        DiagnosticError: the module cannot be imported or built.
    """

    def __init__(self, compiled: Compiled, module: str) -> None:
        self._code = module_view(compiled.code, module)
        self.restart()

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that the module reads, directly or indirectly."""
        return tuple(s.name for s in self._code.sensors)

    def step(self, frame: Frame) -> Answer:
        """Return the module's answer in a frame."""
        machine = self._machine
        machine.begin(frame)
        machine.run(decides=False)
        machine.commit()
        (answer,) = machine.answers.values()
        return answer

    def restart(self) -> None:
        """Restart from the initial memory, with a new instance of the module.

        Raises:
            DiagnosticError: it cannot be built.
        """
        self._machine = OpMachine(self._code)


def _restored(name: str, kind: Kind, value: object) -> float | bool | int:
    match kind:
        case Kind.BOOL if isinstance(value, bool):
            return value
        case Kind.NUMBER if isinstance(value, float):
            return value
        case Kind.TIME if isinstance(value, int) and not isinstance(value, bool):
            return value
        case _:
            raise ValueError(f"memory of {name}: found {value!r}, expected a {kind.value}")
