"""Runs of the program itself that break contracts where formulas cannot decide: tests, long runs, drawn ones.

None of them is drawn from declarations that a contract does not depend on, so neither is its verdict.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from random import Random
from typing import assert_never

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.ir.expression import Reduce, SensorValue, children
from colony.ir.frame import Frame, Outcome, OverriddenCommand
from colony.ir.program import (
    ActuatorField,
    AnyModule,
    Let,
    Module,
    Program,
    PythonModule,
    Sensor,
    TransferFunction,
    is_regular,
    robot_in_base_units,
)
from colony.ir.types import (
    BOOL,
    Array,
    Bool,
    Enum,
    Quantity,
    Scalar,
    ScalarValue,
    Value,
    any_value,
    element_type,
)
from colony.ir.walk import expressions
from colony.verify.contracts.results import RESOURCES_PER_SECOND
from colony.verify.contracts.solver import Deadline
from colony.verify.explain.answer import explain_breach
from colony.verify.explain.text import short
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot, snapshot_of
from colony.verify.symbolic.system import Disturbance
from colony.verify.testing.examples import BreachFacts, facts_of_breach
from colony.verify.testing.frames import Choices, snapshots_of
from colony.verify.testing.guided import Guide, disturbed_run

# --- replay --------------------------------------------------------------------------------------------
#
# Runs of the reference interpreter over snapshots, with stand-ins for modules written in Python.
#
# A stand-in is a module of the language that reads what the Python module reads, and takes its command from
# additional sensors. So the interpreter needs no change, and none of the user's code runs.


_SMALL_PROGRAM = 60
"""Maximum number of declarations of a small program."""

_COST_OF_EVALUATION = RESOURCES_PER_SECOND // 200_000
"""Cost of an expression that the interpreter evaluates, in z3's resource units."""

_MAX_COST = 3 * RESOURCES_PER_SECOND
"""Cost of all frames that are computed for one trace, at most."""


class Replay:
    """Replays traces of `program` for one of its contracts, or, without one, for all that are not assumed.

    A trace breaks the contract only if its frames are as regular as the robot says, none of the modules in
    Python `uncalled` is called in any frame, and commands from outside the network are within the bounds of
    their frames. Each frame is charged to `deadline`.
    """

    def __init__(
        self,
        program: Program,
        contract: str | None,
        uncalled: Collection[str] = (),
        deadline: Deadline | None = None,
    ) -> None:
        self._contract, self.uncalled = contract or "", uncalled
        watched = (c for c in program.contracts if c.name == contract or (contract is None and not c.assumed))
        self.program = replace(with_stand_ins(program), contracts=tuple(watched))
        self._deadline = Deadline() if deadline is None else deadline
        self._cost = _COST_OF_EVALUATION * evaluations(self.program)
        self._fields = {
            m.name: _command_fields(program, m) for m in program.modules if isinstance(m, PythonModule)
        }

    @property
    def affordable_frames(self) -> int:
        """Number of frames to afford before the deadline, and for one trace."""
        return int(max(0, min(_MAX_COST, self._deadline.left) // self._cost))

    def affordable_runs(self, max_runs: int, frames: int = 1) -> int:
        """Return the number of runs to afford: `max_runs` for a small program, fewer for a large one."""
        program = self.program
        size = len(program.modules) + len(program.derived) + len(program.wires) + len(program.robot.sensors)
        affordable = max_runs if size <= _SMALL_PROGRAM else max_runs * _SMALL_PROGRAM // size
        return min(affordable, self.affordable_frames // frames)

    def run(self, snapshots: Sequence[Snapshot]) -> tuple[Outcome, ...]:
        """Return the interpreter's outcomes from its initial memory, up to the contract's first breach."""
        return self._run(snapshots)[0]

    def breaks(self, snapshots: Sequence[Snapshot]) -> bool:
        """Return True if the contract is broken in one of the frames."""
        return self.breach(snapshots) is not None

    def breach(self, snapshots: Sequence[Snapshot]) -> int | None:
        """Return the index of the first frame that breaks the contract, None if none does."""
        return self.outcomes_and_breach(snapshots)[1]

    def outcomes_and_breach(self, snapshots: Sequence[Snapshot]) -> tuple[tuple[Outcome, ...], int | None]:
        """Return the outcomes up to the contract's first breach, and the `breach`."""
        outcomes, is_possible = self._run(snapshots)
        broken = bool(outcomes) and bool(outcomes[-1].breaches) and is_possible
        return outcomes, len(outcomes) - 1 if broken else None

    def facts(self, snapshots: Sequence[Snapshot]) -> BreachFacts:
        """Return the facts of the frame that breaks the contract."""
        return facts_of_breach(self.program, self._contract, self.with_answers(snapshots))

    def cause(self, snapshots: Sequence[Snapshot]) -> str:
        """Return the conditions for which the last frame breaks the contract."""
        return short(explain_breach(self.program, self._contract, self.with_answers(snapshots)))

    def with_answers(self, snapshots: Sequence[Snapshot]) -> tuple[Snapshot, ...]:
        """Return snapshots for `program`, in which readings stand in for the answers of modules in Python."""
        return tuple(s._replace(readings=self._readings(s)) for s in snapshots)

    def _run(self, snapshots: Sequence[Snapshot]) -> tuple[tuple[Outcome, ...], bool]:
        """Return the outcomes, and False if a module of `uncalled` was called or a command was out of bounds.

        The stand-in of a module that is called is active.
        """
        outcomes = list[Outcome]()
        is_possible = is_regular(self.program.robot, (s.t_ns for s in snapshots))
        for snapshot, (outcome, interpreter) in zip(snapshots, self.frames(snapshots), strict=False):
            outcomes.append(outcome)
            self._deadline.charge(self._cost)
            is_possible = (
                is_possible
                and not any(interpreter.is_active(m) and not interpreter.is_blind(m) for m in self.uncalled)
                and all(self._is_allowed(name, given, interpreter) for name, given in snapshot.given.items())
            )
            if outcome.breaches:
                break
        return tuple(outcomes), is_possible

    def _is_allowed(self, name: str, given: OverriddenCommand, interpreter: Interpreter) -> bool:
        """Return True for a command within the bounds of the last frame, and for none."""
        if given.values is None:
            return True
        bounds = interpreter.bounds(next(a for a in self.program.robot.actuators if a.name == name))
        if bounds is None:
            return False
        return all(low <= x <= high for x, (low, high) in zip(given.values, bounds, strict=True))

    def frames(self, snapshots: Sequence[Snapshot]) -> Iterator[tuple[Outcome, Interpreter]]:
        """Yield the outcome of each frame, with the interpreter as it is after that frame."""
        interpreter = Interpreter(self.program)
        for snapshot in snapshots:
            outcome = interpreter.step_in_base_units(
                snapshot.t_ns,
                self._readings(snapshot),
                snapshot.lost,
                snapshot.given,
                restarted=snapshot.restarted,
            )
            yield outcome, interpreter

    def _readings(self, snapshot: Snapshot) -> dict[str, Value | None]:
        readings = dict(snapshot.readings)
        for module, fields in self._fields.items():
            answer = snapshot.answers.get(module)
            is_blind = answer is None and module in snapshot.answers
            if module in self.uncalled or not is_blind:
                readings[_activation_sensor_name(module)] = module in self.uncalled or answer is not None
            for i, field in enumerate(fields):
                readings[_field_sensor_name(module, i)] = (
                    any_value(field.type) if answer is None else answer[i]
                )
        return readings


def evaluations(program: Program) -> int:
    """Return about how many expressions a frame of a program evaluates, those of each round of reductions."""
    work, total = [(e, 1) for e in expressions(program)], 1
    while work:
        node, times = work.pop()
        total += times
        rounds = node.high - node.low + 1 if isinstance(node, Reduce) else 1
        work += [(child, times * max(rounds, 1)) for child in children(node)]
    return total + sum(s.type.size for s in program.robot.sensors if isinstance(s.type, Array)) // 10


def is_stand_in(sensor: Sensor) -> bool:
    """Return True for a sensor that stands in for the answers of a module in Python."""
    return " " in sensor.name


def _activation_sensor_name(module: str) -> str:
    """Return the name of the sensor that activates a stand-in; names of the language have no blanks."""
    return f"{module} answers"


def _field_sensor_name(module: str, i: int) -> str:
    return f"{module} answers {i}"


def with_stand_ins(program: Program) -> Program:
    """Return the program with stand-ins for its modules in Python, which answer by sensors."""
    python = [m for m in program.modules if isinstance(m, PythonModule)]
    sensors = [s for m in python for s in _stand_in_sensors(program, m)]
    modules = tuple(_stand_in(program, m) if isinstance(m, PythonModule) else m for m in program.modules)
    robot = replace(program.robot, sensors=(*program.robot.sensors, *sensors))
    return replace(program, robot=robot, modules=modules)


def _command_fields(program: Program, module: PythonModule) -> tuple[ActuatorField, ...]:
    return next((a.fields for a in program.robot.actuators if a.name == module.actuator), ())


def _stand_in_sensors(program: Program, module: PythonModule) -> list[Sensor]:
    sensors = [Sensor(name=_activation_sensor_name(module.name), type=BOOL, server="", field="")]
    for i, field in enumerate(_command_fields(program, module)):
        sensors.append(Sensor(name=_field_sensor_name(module.name, i), type=field.type, server="", field=""))
    return sensors


def _stand_in(program: Program, module: PythonModule) -> AnyModule:
    lets = tuple(Let(name=f"{module.name}.{r.name}", expression=r.expression) for r in module.reads)
    fields = tuple(
        SensorValue(type=f.type, name=_field_sensor_name(module.name, i))
        for i, f in enumerate(_command_fields(program, module))
    )
    return Module(
        name=module.name,
        span=module.span,
        failsafe=module.failsafe,
        lets=lets,
        when=SensorValue(type=BOOL, name=_activation_sensor_name(module.name)),
        command=TransferFunction(actuator=module.actuator, fields=fields) if module.actuator else None,
    )


# --- concrete runs -------------------------------------------------------------------------------------


_TRACES = 150
_FRAMES = 8
"""Number and length of the drawn runs of the interpreter, each of which learns from those before."""

LONG_FRAMES = 1000
"""Length of a long run, in frames."""

_LONG_RUNS = 24
"""Number of long runs of a small program: in half of them no reading ever changes."""

_SMALL_CODE = 2000
"""Maximum number of nodes in the compiled form of a small program."""


def drawn_counterexample(
    program: Program, replay: Replay, disturbance: Disturbance | None = None
) -> tuple[Snapshot, ...] | None:
    """Return the first of a few drawn runs that breaks the contract, None if none does. Deterministic.

    With a disturbance, actuators are idle and modules lost in some frames; with `OPERATORS`, connections
    command actuators in others.
    """
    guide = Guide(program, _FRAMES)
    for seed in range(replay.affordable_runs(_TRACES, _FRAMES)):
        trace = guide.draw(Choices(Random(seed)))
        snapshots = tuple(snapshot_of(program, frame) for frame in trace)
        if disturbance is not None:
            operators = disturbance is Disturbance.OPERATORS
            disturbed = disturbed_run(Choices(Random(seed)), replay.program, trace, operators=operators)
            snapshots = tuple(
                snapshot._replace(given=frame.given, lost=frame.lost)
                for snapshot, frame in zip(snapshots, disturbed, strict=True)
            )
        outcomes, breach = replay.outcomes_and_breach(snapshots)
        if breach is not None:
            return snapshots
        guide.learn(trace, [tuple((d.by, d.fault) for d in o.decisions) for o in outcomes])
    return None


class GeneratedRuns:
    """Runs of a program in generated Python, from readings in base units. Stateful: holds an executor."""

    def __init__(self, program: Program) -> None:
        program = replace(program, robot=robot_in_base_units(program.robot), tests=())
        compiled = compile_program(program).compiled
        self.size = len(compiled.code.ops)  # of the program, in nodes of its compiled form
        self._executor = load(generate(compiled))

    def outcomes(self, trace: Iterable[Snapshot]) -> Iterator[Outcome]:
        """Yield the outcome of each frame of a run that begins with the initial memory."""
        self._executor.restart()
        for s in trace:
            yield self._executor.step(Frame(s.t_ns, s.readings, restarted=s.restarted))


class LongRuns:
    """Tests and long runs of one program, in generated Python. Stateful: run when first asked for.

    All contracts are evaluated in the same runs. Modules in Python answer "not applicable".
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._breaking: dict[str, tuple[Snapshot, ...]] | None = None

    def breaking(self, contract: str) -> tuple[Snapshot, ...] | None:
        """Return a run whose last frame breaks the contract in generated Python, None if none does."""
        if self._breaking is None:
            self._breaking = {}
            for snapshots, broken in self._broken():
                self._breaking.setdefault(broken, snapshots)
        return self._breaking.get(contract)

    def _broken(self) -> Iterator[tuple[tuple[Snapshot, ...], str]]:
        """Yield each contract that a run breaks, with the run up to there."""
        program = with_stand_ins(self._program)
        runs = GeneratedRuns(program)
        count = max(2, int(_LONG_RUNS * min(1, _SMALL_CODE / runs.size)))
        for snapshots in (*self._tests(), *(long_run(program, i) for i in range(count))):
            seen = set[str]()
            for i, outcome in enumerate(runs.outcomes(snapshots), 1):
                for name in set(outcome.breaches) - seen:
                    seen.add(name)
                    yield snapshots[:i], name

    def _tests(self) -> Iterator[tuple[Snapshot, ...]]:
        for example in self._program.tests:
            snapshots = snapshots_of(self._program, example)
            if is_regular(self._program.robot, (s.t_ns for s in snapshots)):
                yield snapshots


# --- long runs -----------------------------------------------------------------------------------


def long_run(program: Program, number: int) -> tuple[Snapshot, ...]:
    """Return a run in which each sensor follows a signal of its own: constant, or in steps."""
    sensors = [s for s in program.robot.sensors if s.sent is None and not is_stand_in(s)]
    signals = [(s.name, _signal(s, number)) for s in sensors]
    snapshots = []
    for i in range(LONG_FRAMES):
        readings = {name: next(signal) for name, signal in signals}
        snapshots.append(
            Snapshot(i * program.robot.frame_ns, {n: x for n, x in readings.items() if x is not None})
        )
    return tuple(snapshots)


def _signal(sensor: Sensor, number: int) -> Iterator[Value | None]:
    """Yield the readings of a sensor in a run, None where it is missing; they depend on nothing else."""
    random = Random(f"{number} {sensor.name}")
    plain = plain_values(sensor)
    if number < 4:  # all at once: at their defaults, at an end of their ranges, and next to 0
        chosen = plain[min(number, len(plain) - 1)]
        while True:
            yield _filled(sensor, chosen)
    while True:
        value = None if random.random() < 1 / 16 else _drawn(sensor, plain, random)
        held = LONG_FRAMES if number % 2 == 0 else random.choice((1, 1, 2, 5, 20, 100))
        for _ in range(held):
            yield value


def _drawn(sensor: Sensor, plain: Sequence[ScalarValue], random: Random) -> Value:
    if not isinstance(sensor.type, Array) or random.random() < 1 / 2:
        return _filled(sensor, _scalar(sensor, plain, random))
    few = [_scalar(sensor, plain, random) for _ in range(3)]
    return tuple(random.choice(few) for _ in range(sensor.type.size))


def _scalar(sensor: Sensor, plain: Sequence[ScalarValue], random: Random) -> ScalarValue:
    if isinstance(element_type(sensor.type), Quantity) and random.random() < 1 / 2:
        low, high = _range(sensor)
        return random.uniform(low, high)
    return random.choice(plain)


def _filled(sensor: Sensor, value: ScalarValue) -> Value:
    return (value,) * sensor.type.size if isinstance(sensor.type, Array) else value


def plain_values(sensor: Sensor) -> list[ScalarValue]:
    """Return plain values in base units: the default or 0, the ends of the range, and tiny numbers."""
    of: Scalar = element_type(sensor.type)
    match of:
        case Bool():
            return [sensor.default is True, True, False]
        case Enum(members=members):
            return [value for _, value in members]
        case Quantity():
            low, high = _range(sensor)
            first = 0.0 if sensor.default is None else float(sensor.default)
            inner = (math.nextafter(low, high), math.nextafter(high, low), low / 3, high / 3)
            values = (first, low, high, -1e-20, *inner, 5e-324, -5e-324, 1e-20, 0.1, 1.0, -1.0)
            return [x for x in dict.fromkeys(values) if low <= x <= high]
        case _:
            assert_never(of)


def _range(sensor: Sensor) -> tuple[float, float]:
    """Return the range in base units; a thousand declared units where there is none."""
    low = -1000.0 * sensor.factor if sensor.low is None else sensor.low
    high = 1000.0 * sensor.factor if sensor.high is None else sensor.high
    return min(low, high), max(low, high)
