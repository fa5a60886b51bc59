"""The machine that runs `Code` op by op, with its own memory.

The function that computes an op is chosen once, when the machine is built; a frame takes one call per op.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

from colony.execute.code import (
    Apply,
    Code,
    Commanded,
    FrameTime,
    Literal,
    Lost,
    OldCell,
    Op,
    PythonActive,
    PythonBlind,
    PythonCall,
    PythonField,
    Restarted,
    SensorElement,
    SensorFresh,
    Sent,
    Table,
    Winner,
)
from colony.execute.decisions import ActuatorDecision
from colony.execute.intake import Records, age_limits, of_age, validate_reading
from colony.execute.operators import FUNCTIONS, Operator
from colony.execute.python_step import PythonStep
from colony.ir.frame import Answer, Frame, FrameEvent
from colony.ir.types import Array, Bool, Enum
from colony.text.diagnostics import DiagnosticError, error

Step = Callable[[], Any]
"""A function that computes the value of one op in the current frame."""


class OpMachine:
    """A machine that runs the ops of a Code over its memory. Mutable.

    In each frame call `begin`, `run`, then (if there are decisions to make) `record_decision` for each
    actuator and `run_after_decisions`, then `commit`. With `answers_given` Python modules run elsewhere, and
    `begin` takes their answers.
    """

    def __init__(self, code: Code, *, answers_given: bool = False) -> None:
        self.code = code
        self.values: list[Any] = [None] * len(code.ops)
        self.cells: list[float | bool | int] = [c.initial for c in code.cells]
        self.first_ns: int | None = None
        self.answers: dict[str, Answer] = {}
        self.python = {} if answers_given else {call.module: build(call) for call in code.python}
        self._t, self._restarted = 0, False
        self._sensors: dict[str, Any] = {}
        self._fresh: dict[str, bool] = {}
        self._python_called = False
        self._lost: frozenset[str] = frozenset()
        self._decided: dict[str, ActuatorDecision] = {}
        self._records: Records = ()
        self._within_ns = age_limits(self.code.sensors)
        self._arrays = frozenset(s.name for s in code.sensors if isinstance(s.type, Array))
        self._steps: list[tuple[int, Step]] = []
        for i, op in enumerate(code.ops):
            if isinstance(op, Literal):
                self.values[i] = op.value
            else:
                self._steps.append((i, self._step(op)))
        self._decided_from = sum(i < code.decided for i, _ in self._steps)

    def begin(
        self, frame: Frame, answers: Mapping[str, Answer] | None = None, lost: frozenset[str] = frozenset()
    ) -> None:
        """Begin a frame; `answers` and `lost` are as for `ClientsExecutor.step`."""
        if self.first_ns is None:
            self.first_ns = frame.t_ns
        self._t, self._restarted = frame.t_ns - self.first_ns, frame.restarted
        self.answers, self._lost = dict(answers or ()), lost
        self._python_called = False
        self._records = ()
        self._decided.clear()
        readings: Mapping[str, Any] = frame.readings
        if frame.taken_ns:
            readings = of_age(frame.t_ns, readings, frame.taken_ns, self._within_ns)
        for sensor in self.code.sensors:
            value, fresh, self._records = validate_reading(sensor, readings.get(sensor.name), self._records)
            self._sensors[sensor.name], self._fresh[sensor.name] = value, fresh

    def run(self, *, decides: bool = True) -> None:
        """Compute the ops before decisions or, unless `decides`, all ops; then call the Python modules."""
        values = self.values
        for i, step in self._steps[: self._decided_from] if decides else self._steps:
            values[i] = step()
        self._call_python()

    def run_after_decisions(self) -> None:
        """Compute the ops that depend on decisions."""
        values = self.values
        for i, step in self._steps[self._decided_from :]:
            values[i] = step()

    def record_decision(self, actuator: str, decided: ActuatorDecision) -> None:
        """Store a decision for the ops that depend on it, and add its records."""
        self._decided[actuator] = decided
        self._records += decided.records

    def commit(self) -> None:
        """Advance memory to the next frame."""
        values = self.values
        updates = [
            (i, values[cell.value]) for i, cell in enumerate(self.code.cells) if values[cell.condition]
        ]
        for i, value in updates:
            self.cells[i] = value

    def records(self) -> tuple[FrameEvent, ...]:
        """Return the records of the frame so far."""
        return tuple(FrameEvent(kind, subject) for kind, subject in self._records)  # type: ignore[arg-type]

    def _step(self, op: Op) -> Step:
        """Return the function that computes an op from earlier values and the frame's input."""
        values = self.values
        match op:
            case Apply(operator=operator, arguments=arguments):
                return _operator_step(operator, arguments, values)
            case SensorElement(sensor=sensor, index=index):
                sensors = self._sensors
                if sensor in self._arrays:
                    return lambda: sensors[sensor][index]
                return lambda: sensors[sensor]
            case OldCell(cell=cell):
                return lambda: self.cells[cell]
            case SensorFresh(sensor=sensor):
                fresh = self._fresh
                return lambda: fresh[sensor]
            case FrameTime():
                return lambda: self._t
            case Restarted():
                return lambda: self._restarted
            case Table(elements=elements):
                return lambda: tuple([values[i] for i in elements])
            case _:
                return self._external_step(op)

    def _external_step(self, op: Op) -> Step:
        """Return the function for an op that depends on Python modules, lost clients or decisions."""
        decided = self._decided
        match op:
            case PythonActive(module=module):
                return lambda: self._python_answer(module).values is not None
            case PythonBlind(module=module):
                return lambda: self._python_answer(module).blind
            case PythonField(module=module, index=index):
                return lambda: (
                    0.0 if (fields := self._python_answer(module).values) is None else fields[index]
                )
            case Lost(module=module):
                return lambda: module in self._lost
            case Winner(actuator=actuator, module=module):
                return lambda: decided[actuator].by == module
            case Commanded(actuator=actuator):
                return lambda: decided[actuator].is_commanded
            case Sent(actuator=actuator, index=index):
                return lambda: 0.0 if (sent := decided[actuator].sent) is None else sent[index]
            case _:
                raise AssertionError(f"{op} depends on no Python module, client or decision")

    def _call_python(self) -> None:
        """Call the Python modules in order, once a frame: before the first op that needs one, or last."""
        if self._python_called:
            return
        self._python_called = True
        for call in self.code.python:
            step = self.python.get(call.module)
            if step is not None:
                active, blind, fields, records = step.step(self._t, self._python_input(call), ())
                self.answers[call.module] = Answer(fields if active else None, bool(records), blind)
            if self.answers[call.module].error:
                self._records = (*self._records, ("python error", call.module))

    def _python_input(self, call: PythonCall) -> dict[str, object] | None:
        """Return the input of a Python module in this frame, None if something in it is missing."""
        values = self.values
        if not values[call.present]:
            return None
        return {
            read.name: tuple([values[i] for i in read.elements]) if read.array else values[read.elements[0]]
            for read in call.reads
        }

    def _python_answer(self, module: str) -> Answer:
        """Return a Python module's answer in this frame."""
        self._call_python()
        return self.answers[module]


INLINE: Mapping[Operator, Callable[..., Step]] = MappingProxyType(
    {
        Operator.NOT: lambda v, a: lambda: not v[a],
        Operator.AND: lambda v, a, b: lambda: v[a] and v[b],
        Operator.OR: lambda v, a, b: lambda: v[a] or v[b],
        Operator.SELECT: lambda v, a, b, c: lambda: v[b] if v[a] else v[c],
        Operator.ADD: lambda v, a, b: lambda: v[a] + v[b],
        Operator.SUBTRACT: lambda v, a, b: lambda: v[a] - v[b],
        Operator.MULTIPLY: lambda v, a, b: lambda: v[a] * v[b],
        Operator.LESS: lambda v, a, b: lambda: v[a] < v[b],
        Operator.LESS_EQUAL: lambda v, a, b: lambda: v[a] <= v[b],
        Operator.EQUAL: lambda v, a, b: lambda: v[a] == v[b],
        Operator.TIME_ADD: lambda v, a, b: lambda: v[a] + v[b],
        Operator.TIME_SUBTRACT: lambda v, a, b: lambda: v[a] - v[b],
        Operator.TIME_LESS: lambda v, a, b: lambda: v[a] < v[b],
    }
)
"""Inlined `FUNCTIONS`, on a list of values and indices into it: one call fewer for each op."""

_VARIADIC = (Operator.AND, Operator.OR)


def _operator_step(operator: Operator, arguments: tuple[int, ...], values: list[Any]) -> Step:
    """Return the function that applies an operator to earlier values."""
    inline = INLINE.get(operator)
    if inline is None or (operator in _VARIADIC and len(arguments) != 2):
        return _call_step(FUNCTIONS[operator], arguments, values)
    return inline(values, *arguments)


def _call_step(function: Callable[..., Any], arguments: tuple[int, ...], values: list[Any]) -> Step:
    match arguments:
        case (only,):
            return lambda: function(values[only])
        case (left, right):
            return lambda: function(values[left], values[right])
        case _:
            return lambda: function(*[values[i] for i in arguments])


def build(call: PythonCall) -> PythonStep:
    """Import and build the class of a Python module.

    Raises:
        DiagnosticError: it cannot be imported or built.
    """
    try:
        instance = getattr(import_module(call.module_path), call.class_name)(**dict(call.params))
    except (Exception, SystemExit) as problem:
        path = f"{call.module_path}:{call.class_name}"
        message = f"`{path}` cannot be imported and built: {type(problem).__name__}: {problem}"
        hint = (
            "the class must be importable from the folder of the behavior or the current folder, "
            "and take its params as keyword arguments"
        )
        raise DiagnosticError([error("P001", call.span, message, hint)]) from problem
    return PythonStep(call.module, instance, field_types(call), call.rate_ns, defaults(call))


def defaults(call: PythonCall) -> dict[str, float | bool]:
    """Return the fields that an answer of a Python module may leave out, each with its value then."""
    return {field.name: field.default for field in call.fields if field.default is not None}


def field_types(call: PythonCall) -> tuple[tuple[str, object], ...]:
    """Return name and type of each field of a Python module's command, as `PythonStep` expects them."""
    return tuple(
        (
            f.name,
            False
            if isinstance(f.type, Bool)
            else tuple(number for _, number in f.type.members)
            if isinstance(f.type, Enum)
            else None,
        )
        for f in call.fields
    )
