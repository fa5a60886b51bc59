"""Executes a compiled program op by op: all of its clients, or one client in the runtime.

Plain and unhurried; what is generated from the same Code (`colony.compile.backends`) is fast.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from colony.execute.code import ActuatorCode, ClientCode, Kind, OutsideActive
from colony.execute.compiled import Compiled
from colony.execute.decisions import decide
from colony.execute.machine import Machine
from colony.execute.views import of_activity, of_client, unsimplified, whole
from colony.ir.frame import Decision, Frame, Outcome, Record
from colony.ir.memory import ProgramMemory
from colony.ir.types import ScalarValue


class NotExclusive(Exception):
    """Two exclusive guards of one actuator were true in a frame, which no compiled client list allows."""


class ClientListExecutor:
    """Executes a program as its clients (an `ir.frame.Executor`). Mutable: it has all of the memory.

    The winner is the first client whose guard holds or, if `exclusive`, the one whose exclusive guard holds.

    Args:
        compiled: the program.
        exclusive: whether the exclusive guards decide.
        simplified: whether simplified guards decide. By the others time constants have places in `memory`,
            and nothing is owed to the last pass.

    Raises:
        Failure: a Python module's class cannot be imported or built.
        NotExclusive: in `step`, if `exclusive`, and more than one holds.
    """

    def __init__(self, compiled: Compiled, *, exclusive: bool = False, simplified: bool = True) -> None:
        self.code = whole(compiled.code) if simplified else unsimplified(compiled.code)
        self._machine = Machine(self.code)
        self._exclusive = exclusive

    def step(self, frame: Frame) -> Outcome:
        """One frame: every actuator's decision, what was recorded, contracts that were broken."""
        machine, code = self._machine, self.code
        machine.begin(frame)
        machine.run(0, code.decided)
        decisions = tuple(self._decide(actuator) for actuator in code.actuators)
        machine.run(code.decided, len(code.ops))
        values = machine.values
        breaches = tuple(c.name for c in code.contracts if values[c.present] and not values[c.value])
        machine.commit()
        return Outcome(decisions, machine.records(), breaches)

    def restart(self) -> None:
        """Go on from the initial memory, with Python modules built anew.

        Raises:
            Failure: one of them cannot be built.
        """
        self._machine = Machine(self.code)

    @property
    def memory(self) -> ProgramMemory | None:
        """The memory, by guards that are not simplified; None with modules in Python: they have theirs."""
        machine = self._machine
        if self.code.python:
            return None
        cells = {name: machine.cells[i] for name, i in self.code.places.items()}
        return ProgramMemory(first_ns=machine.first_ns, cells=cells)

    def resume(self, memory: ProgramMemory) -> None:
        """Go on from what another executor remembered.

        Raises:
            ValueError: it is not the memory of this program: its cells or their types differ.
        """
        places = self.code.places
        if self.code.python or memory.cells.keys() != places.keys():
            raise ValueError("the memory is of another program")
        cells, machine = self.code.cells, Machine(self.code)
        for name, i in places.items():
            machine.cells[i] = _restored(name, cells[i].kind, memory.cells[name])
        machine.first_ns = memory.first_ns
        self._machine = machine

    def _decide(self, actuator: ActuatorCode) -> Decision:
        winner = self._winner(actuator)
        decided = decide(actuator, winner, self._machine.values)
        self._machine.decided(actuator.actuator.name, decided)
        return Decision(actuator.actuator.name, decided.by, decided.leaving, decided.fault)

    def _winner(self, actuator: ActuatorCode) -> ClientCode | None:
        values = self._machine.values
        if not self._exclusive:
            return next((c for c in actuator.clients if values[c.guard]), None)
        holding = [c for c in actuator.clients if values[c.exclusive]]
        if len(holding) > 1:
            raise NotExclusive(f"{actuator.actuator.name}: {', '.join(c.module for c in holding)}")
        return holding[0] if holding else None


# --- one client ----------------------------------------------------------------------------------


Bid = Literal["command", "suppressed", "inhibited", "silent"]


class ClientStep(NamedTuple):
    """What a client has for its server in a frame: whether it is active by its own knowledge, its command.

    `values` are the command in base units within limits and range; None unless active, and when the command
    is not finite (`fault`), where the actuator gets its idle command. `bid` tells why it is not active: its
    predicate holds, but another's command takes its place ("suppressed") or its gates are closed
    ("inhibited"), or its predicate does not hold or something is missing ("silent"). One that is both
    dominated and gated is "inhibited"; one whose command has several ways to the actuator, all of them
    closed in one manner or the other, is "suppressed".
    """

    active: bool
    values: tuple[ScalarValue, ...] | None
    fault: str | None
    records: tuple[Record, ...]
    bid: Bid


class ClientMemory(NamedTuple):
    """All that a client remembers, as plain data.

    `first_ns` is the time of its first frame, `cells` are by name. `answers` are (due, pending, standing) of
    the client's own Python module, if it has one; what that module's object remembers is its own.
    """

    first_ns: int | None
    cells: dict[str, float | bool | int]
    answers: tuple[Any, Any, Any] | None = None


class ClientExecutor:
    """Executes the slice of a program that one client needs. Mutable: it has the client's memory.

    Raises:
        KeyError: there is no such client.
        Failure: the client's own Python module cannot be imported or built.
    """

    def __init__(self, compiled: Compiled, actuator: str, module: str) -> None:
        self.code = of_client(compiled.code, actuator, module)
        self._machine = Machine(self.code)
        (self._actuator,) = self.code.actuators
        (self._client,) = self._actuator.clients

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that it reads."""
        return tuple(s.name for s in self.code.sensors)

    @property
    def outside(self) -> tuple[str, ...]:
        """The Python modules elsewhere whose activity `step` has to be told."""
        return tuple(op.module for op in self.code.ops if isinstance(op, OutsideActive))

    def step(
        self, frame: Frame, active: Mapping[str, bool] | None = None, lost: frozenset[str] = frozenset()
    ) -> ClientStep:
        """One frame, with the activity of the `outside` modules, and the modules whose clients are lost.

        Raises:
            KeyError: `active` lacks one of `outside`.
        """
        machine = self._machine
        machine.begin(frame, active or {}, lost)
        machine.run(0, len(self.code.ops))
        won = bool(machine.values[self._client.exclusive])
        decided = decide(self._actuator, self._client if won else None, machine.values)
        machine.decided(self._actuator.actuator.name, decided)
        machine.commit()
        values = decided.sent if won and decided.fault is None else None
        return ClientStep(won, values, decided.fault, machine.records(), self._bid())

    def restart(self) -> None:
        """Go on from the initial memory, with its own Python module built anew.

        Raises:
            Failure: that cannot be built.
        """
        self._machine = Machine(self.code)

    @property
    def portable(self) -> bool:
        """Whether `memory` is all that it remembers: it has no Python module of its own."""
        return not self.code.python

    def _bid(self) -> Bid:
        client, values = self._client, self._machine.values
        if values[client.exclusive]:
            return "command"
        if not values[client.active]:
            return "silent"
        return "suppressed" if values[client.guard] or client.several_ways else "inhibited"

    @property
    def memory(self) -> ClientMemory:
        """A copy of all that it remembers."""
        machine = self._machine
        cells = {cell.name: value for cell, value in zip(self.code.cells, machine.cells, strict=True)}
        steps = list(machine.python.values())
        answers = (steps[0].due, steps[0].pending, steps[0].standing) if steps else None
        return ClientMemory(machine.first_ns, cells, answers)

    @memory.setter
    def memory(self, memory: ClientMemory) -> None:
        """Go on from `memory`.

        Raises:
            ValueError: it is not of this client: its cells or their types differ.
        """
        machine = self._machine
        if memory.cells.keys() != {c.name for c in self.code.cells}:
            raise ValueError("the memory is of another client")
        restored = [_restored(c.name, c.kind, memory.cells[c.name]) for c in self.code.cells]
        machine.first_ns, machine.cells = memory.first_ns, restored
        for step in machine.python.values():
            step.due, step.pending, step.standing = memory.answers or (0, None, None)


class ActivityExecutor:
    """Executes the slice that tells whether a module in Python is active. Mutable: the module's memory.

    Raises:
        KeyError: there is no such module.
        Failure: the module cannot be imported or built; so may `restart`.
    """

    def __init__(self, compiled: Compiled, module: str) -> None:
        self._code = of_activity(compiled.code, module)
        self.restart()

    def step(self, frame: Frame) -> bool:
        """Return whether it has a command in this frame."""
        machine, (active,) = self._machine, self._code.contracts
        machine.begin(frame)
        machine.run(0, len(self._code.ops))
        machine.commit()
        return bool(machine.values[active.value])

    def restart(self) -> None:
        """Go on from the initial memory, with the module built anew."""
        self._machine = Machine(self._code)


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
