"""Runs of the reference interpreter over snapshots, with stand-ins for modules written in Python.

A stand-in is a module of the language that reads what the Python module reads, and commands what one more
sensor says: so the interpreter itself needs no change, and no code of the user's is run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from colony.ir.expression import SensorValue
from colony.ir.frame import Outcome
from colony.ir.program import (
    ActuatorField,
    AnyModule,
    Command,
    Example,
    Given,
    Let,
    Module,
    Program,
    PythonModule,
    Sensor,
    Step,
)
from colony.ir.types import BOOL, Bool, Enum, Scalar, ScalarValue, Value
from colony.verify.contracts.results import Snapshot
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.examples import run_example

_SMALL = 60
"""How many things a program declares that is not large."""


class Replay:
    """Replays traces of `program` for one of its contracts.

    With `unasked`, a trace breaks the contract only if no module in Python is asked in any of its frames.
    """

    def __init__(self, program: Program, contract: str, unasked: bool = False) -> None:
        self._unasked = unasked
        self.program = replace(
            _with_stand_ins(program), contracts=tuple(c for c in program.contracts if c.name == contract)
        )
        self._fields = {
            m.name: _commanded(program, m) for m in program.modules if isinstance(m, PythonModule)
        }

    def affordable(self, most: int) -> int:
        """How many frames to compute where a small program would have `most`: fewer for a large one."""
        program = self.program
        size = len(program.modules) + len(program.derived) + len(program.wires) + len(program.robot.sensors)
        return most if size <= _SMALL else most * _SMALL // size

    def run(self, snapshots: Sequence[Snapshot]) -> tuple[Outcome, ...]:
        """What the interpreter does from its initial memory, up to the first breach of the contract."""
        return self._run(snapshots)[0]

    def breaks(self, snapshots: Sequence[Snapshot]) -> bool:
        """Whether the contract is broken in one of the frames."""
        outcomes, asked = self._run(snapshots)
        return bool(outcomes) and bool(outcomes[-1].breaches) and not (self._unasked and asked)

    def found(self, snapshots: Sequence[Snapshot]) -> tuple[str, ...]:
        """What the things that the contract names are in the frame that breaks it, a fact each."""
        steps = []
        for snapshot in snapshots:
            readings = self._readings(snapshot)
            given = tuple(
                Given(sensor=s.name, index=None, value=readings.get(s.name))
                for s in self.program.robot.sensors
            )
            steps.append(Step(times_ns=(snapshot.t_ns,), given=given, expectations=()))
        result = run_example(self.program, Example(name="counterexample", steps=tuple(steps)))
        return next((f.found for f in result.failures if f.kind == "contract broken"), ())

    def _run(self, snapshots: Sequence[Snapshot]) -> tuple[tuple[Outcome, ...], bool]:
        """The outcomes, and whether a stand-in answered; with `unasked` they do wherever they are asked."""
        interpreter = Interpreter(self.program)
        outcomes, asked = [], False
        for snapshot in snapshots:
            outcomes.append(interpreter.step_in_base_units(snapshot.t_ns, self._readings(snapshot)))
            asked = asked or any(interpreter.is_active(m) for m in self._fields)
            if outcomes[-1].breaches:
                break
        return tuple(outcomes), asked

    def _readings(self, snapshot: Snapshot) -> dict[str, Value]:
        readings = dict(snapshot.readings)
        for module, fields in self._fields.items():
            answer = snapshot.answers.get(module)
            readings[_answers(module)] = self._unasked or answer is not None
            for i, field in enumerate(fields):
                readings[_answer(module, i)] = _harmless(field.type) if answer is None else answer[i]
        return readings


def _answers(module: str) -> str:
    """The sensor that says whether a stand-in commands; no name of the language has a blank in it."""
    return f"{module} answers"


def _answer(module: str, i: int) -> str:
    return f"{module} answers {i}"


def _harmless(of: Scalar) -> ScalarValue:
    """Some value of a type."""
    match of:
        case Bool():
            return False
        case Enum(members=members):
            return members[0][1]
        case _:
            return 0.0


def _with_stand_ins(program: Program) -> Program:
    python = [m for m in program.modules if isinstance(m, PythonModule)]
    sensors = [s for m in python for s in _sensors(program, m)]
    modules = tuple(_stand_in(program, m) if isinstance(m, PythonModule) else m for m in program.modules)
    robot = replace(program.robot, sensors=(*program.robot.sensors, *sensors))
    return replace(program, robot=robot, modules=modules)


def _commanded(program: Program, module: PythonModule) -> tuple[ActuatorField, ...]:
    return next((a.fields for a in program.robot.actuators if a.name == module.actuator), ())


def _sensors(program: Program, module: PythonModule) -> list[Sensor]:
    given = [Sensor(name=_answers(module.name), type=BOOL, server="", field="")]
    for i, field in enumerate(_commanded(program, module)):
        given.append(Sensor(name=_answer(module.name, i), type=field.type, server="", field=""))
    return given


def _stand_in(program: Program, module: PythonModule) -> AnyModule:
    lets = tuple(Let(name=f"{module.name}.{r.name}", expression=r.expression) for r in module.reads)
    fields = tuple(
        SensorValue(type=f.type, name=_answer(module.name, i))
        for i, f in enumerate(_commanded(program, module))
    )
    return Module(
        name=module.name,
        span=module.span,
        lets=lets,
        when=SensorValue(type=BOOL, name=_answers(module.name)),
        command=Command(actuator=module.actuator, fields=fields) if module.actuator else None,
    )
