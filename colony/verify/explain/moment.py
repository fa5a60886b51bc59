"""A frame of a run, with everything that answers about it need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, TypedDict, TypeVar, Unpack

from colony.ir import expression as ir
from colony.ir.frame import ActuatorOutcome, Answer, Frame, Outcome
from colony.ir.program import Limit, Program
from colony.ir.types import ScalarValue
from colony.ir.walk import all_subexpressions
from colony.verify.explain.causes import Absence
from colony.verify.reference.expressions import FrameValues, Memory
from colony.verify.reference.interpreter import Interpreter
from colony.verify.reference.memory import InterpreterState

# --- history -------------------------------------------------------------------------------------------
#
# Since when things are as they are: a fold over the frames of a run.


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


# --- moment --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """A frame that the interpreter has decided.

    Attributes:
        program: The program.
        k: Number of the frame.
        frame: Its time and readings.
        outcome: The interpreter's decisions.
        values: The values of the frame.
        memory: What memory functions remembered before the frame.
        last_active_ns: For each node of the network, the time before the frame at which its dominant side was
            last active.
        silent: Modules that are silent because something that they read is missing.
        blind: Failsafe modules that are active without an answer.
        limits: Limits that applied, each with its bound; None if that was missing.
        absent: Missing sensors, each with the reason.
        answers: Answers of modules in Python.
        lost: Modules whose clients are lost, where others act in their place.
        late: Actuators that are idle because a client is late, in a run without verdicts.
        verdicts: The verdicts of the runtime, by actuator; none for a run of the interpreter alone.
        history: Since when things are as they are after this frame.
        earlier: Since when they were as they were before it, as states and memory functions read them.
    """

    program: Program
    k: int
    frame: Frame
    outcome: Outcome
    values: FrameValues
    memory: Memory
    last_active_ns: Mapping[tuple[str | int, ...], int]
    silent: frozenset[str]
    blind: frozenset[str]
    limits: tuple[tuple[Limit, float | None], ...]
    absent: Mapping[str, Absence]
    history: History
    earlier: History = NO_HISTORY
    answers: Mapping[str, Answer] = field(default_factory=dict)
    lost: frozenset[str] = frozenset()
    late: frozenset[str] = frozenset()
    verdicts: Mapping[str, ActuatorOutcome] = field(default_factory=dict)

    @property
    def t_ns(self) -> int:
        """The time of the frame."""
        return self.frame.t_ns

    @property
    def is_first(self) -> bool:
        """True if there is nothing to remember: memory was initial before the frame."""
        return self.values.first_ns == self.values.t_ns

    def winner(self, actuator: str) -> str | None:
        """Return the module that the actuator was commanded by, of the runtime where it is known."""
        verdict = self.verdicts.get(actuator)
        return self.outcome.commands[actuator].by if verdict is None else verdict.by

    def sent(self, actuator: str) -> tuple[ScalarValue, ...] | None:
        """Return what the actuator was sent, in declared units; None if nothing."""
        verdict = self.verdicts.get(actuator)
        return self.outcome.commands[actuator].values if verdict is None else verdict.values

    def fault(self, actuator: str) -> str | None:
        """Return why the idle command was sent in place of another, if it was."""
        verdict = self.verdicts.get(actuator)
        return self.outcome.commands[actuator].fault if verdict is None else verdict.fault


class MomentFacts(TypedDict, total=False):
    """What is known of a frame besides the interpreter's state; see `Moment`."""

    k: int
    frame: Frame
    outcome: Outcome
    absent: Mapping[str, Absence]
    earlier: History
    answers: Mapping[str, Answer]
    verdicts: Mapping[str, ActuatorOutcome]
    lost: frozenset[str]
    late: frozenset[str]


def moment_of(
    program: Program,
    interpreter: Interpreter,
    before: InterpreterState | None,
    history: History,
    **seen: Unpack[MomentFacts],
) -> Moment:
    """Return the moment of a frame that the interpreter has decided; `before` is its state before that."""
    names = [m.name for m in program.modules]
    return Moment(
        program=program,
        values=interpreter.values,
        memory={} if before is None else before.memory.functions,
        last_active_ns={} if before is None else before.memory.last_active_ns,
        silent=frozenset(n for n in names if interpreter.is_silent(n)),
        blind=frozenset(n for n in names if interpreter.is_blind(n)),
        limits=interpreter.limits,
        history=history,
        **seen,
    )
