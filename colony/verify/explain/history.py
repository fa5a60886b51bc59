"""Since when things are as they are: a fold over the frames of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeVar

from colony.ir import expression as ir
from colony.ir.program import Program
from colony.ir.types import ScalarValue
from colony.ir.walk import all_subexpressions
from colony.verify.reference.expressions import Memory
from colony.verify.reference.interpreter import Interpreter

Status = Literal["active", "inactive", "silent", "blind"]
"""The state of a module in a frame; a blind one is failsafe, and active without an answer."""

CellKey = tuple[int, tuple[int, ...], int]
"""The key of a memory function's state in the interpreter."""


class Since(NamedTuple):
    """A value, and the time of the first frame that had it; `first` if that is the first frame known."""

    value: ScalarValue | str | None
    t_ns: int
    first: bool = False


class History(NamedTuple):
    """Since when things are as they are after a frame.

    Attributes:
        modules: The status of each module.
        sensors: "present" or "missing" for each sensor.
        states: The value of each state and machine, and the frame that set it, after which it has it.
        cells: What `captured` and `latch` remember, and the frame that set it.
        winners: The winning module of each actuator, None if there is none.
        last_active_ns: The last frame in which a module was active that is not any more.
    """

    modules: Mapping[str, Since]
    sensors: Mapping[str, Since]
    states: Mapping[str, Since]
    cells: Mapping[CellKey, Since]
    winners: Mapping[str, Since]
    last_active_ns: Mapping[str, int]


NO_HISTORY = History({}, {}, {}, {}, {}, {})
"""The history before the first frame."""


class Historian:
    """Follows an interpreter, and remembers since when things are as they are. Stateful."""

    def __init__(self, program: Program, history: History = NO_HISTORY) -> None:
        self._program = program
        self._tracked = {
            e.cell: e.function
            for e in all_subexpressions(program)
            if isinstance(e, ir.MemoryCall)
            and e.function in (ir.MemoryFunction.CAPTURED, ir.MemoryFunction.LATCH)
        }
        self.history = history

    def take(
        self, interpreter: Interpreter, memory: Memory, winners: Mapping[str, str | None], *, first: bool
    ) -> History:
        """Take a frame that the interpreter has decided; `memory` is what it remembers after it.

        `winners` are the winners of actuators. `first` is true for the first frame of which anything is
        known.
        """
        values, before = interpreter.values, self.history
        t_ns = values.t_ns
        modules = {m.name: status(interpreter, m.name) for m in self._program.modules}
        sensors = {
            s.name: "present" if s.name in values.fresh else "missing" for s in self._program.robot.sensors
        }
        states = interpreter.states
        cells = {
            key: _remembered(self._tracked[key[0]], state)
            for key, state in memory.items()
            if key[0] in self._tracked
        }
        gone = {n: t_ns for n, state in modules.items() if state in ("active", "blind")}
        self.history = History(
            _updated(before.modules, modules, t_ns, first),
            _updated(before.sensors, sensors, t_ns, first),
            _updated(before.states, states, t_ns, first),
            _updated(before.cells, cells, t_ns, first),
            _updated(before.winners, winners, t_ns, first),
            {**before.last_active_ns, **gone},
        )
        return self.history


def status(interpreter: Interpreter, module: str) -> Status:
    """Return the status of a module in the last frame."""
    if interpreter.is_blind(module):
        return "blind"
    if interpreter.is_silent(module):
        return "silent"
    return "active" if interpreter.is_active(module) else "inactive"


def _remembered(function: ir.MemoryFunction, state: object) -> ScalarValue | None:
    if function is ir.MemoryFunction.CAPTURED and isinstance(state, tuple):
        return state[0]  # type: ignore[no-any-return]
    return state  # type: ignore[return-value]


K = TypeVar("K", bound=str | CellKey)


def _updated(
    before: Mapping[K, Since], now: Mapping[K, ScalarValue | str | None], t_ns: int, first: bool
) -> Mapping[K, Since]:
    """Return the values of now, each since the frame that first had it."""
    new = {
        key: Since(value, t_ns, first)
        for key, value in now.items()
        if key not in before or not _same(before[key].value, value)
    }
    return before if not new and before.keys() == now.keys() else {k: new.get(k) or before[k] for k in now}


def _same(a: ScalarValue | str | None, b: ScalarValue | str | None) -> bool:
    return a == b or (a != a and b != b)
