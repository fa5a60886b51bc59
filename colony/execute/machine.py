"""The machine that runs `Code` op by op, in memory of its own.

What computes an op is chosen once, when the machine is built; a frame is a call an op.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
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
    OutsideActive,
    PythonActive,
    PythonCall,
    PythonField,
    SensorElement,
    SensorFresh,
    Sent,
    Table,
    Winner,
)
from colony.execute.decisions import Decided, Records
from colony.execute.intake import of_age
from colony.execute.operators import FUNCTIONS
from colony.execute.python_step import PythonStep
from colony.execute.sensors import take, within
from colony.ir.frame import Frame, Record
from colony.ir.types import Array, Bool, Enum, ScalarValue
from colony.text.diagnostics import Failure, error

Step = Callable[[], Any]
"""Computes the value of one op in the present frame."""


class Machine:
    """Runs the ops of a Code over its memory. Mutable.

    A frame is `begin`, `run` of all ops (with `decided` before those that depend on decisions), `commit`.
    """

    def __init__(self, code: Code) -> None:
        self.code = code
        self.values: list[Any] = [None] * len(code.ops)
        self.cells: list[float | bool | int] = [c.initial for c in code.cells]
        self.first_ns: int | None = None
        self.python = {call.module: build(call) for call in code.python}
        self._t = 0
        self._sensors: dict[str, Any] = {}
        self._fresh: dict[str, bool] = {}
        self._answers: dict[str, tuple[bool, tuple[ScalarValue, ...]]] = {}
        self._active: Mapping[str, bool] = {}
        self._lost: frozenset[str] = frozenset()
        self._decided: dict[str, Decided] = {}
        self._records: Records = ()
        self._within_ns = within(self.code.sensors)
        self._arrays = frozenset(s.name for s in code.sensors if isinstance(s.type, Array))
        self._steps = tuple(self._step(op) for op in code.ops)

    def begin(
        self, frame: Frame, active: Mapping[str, bool] | None = None, lost: frozenset[str] = frozenset()
    ) -> None:
        """Take a frame in; `active` and `lost` are as for `ClientExecutor.step`."""
        if self.first_ns is None:
            self.first_ns = frame.t_ns
        self._t = frame.t_ns - self.first_ns
        self._active, self._lost = active or {}, lost
        self._records = ()
        self._answers.clear()
        self._decided.clear()
        readings: Mapping[str, Any] = frame.readings
        if frame.taken_ns:
            readings = of_age(frame.t_ns, readings, frame.taken_ns, self._within_ns)
        for sensor in self.code.sensors:
            value, fresh, self._records = take(sensor, readings.get(sensor.name), self._records)
            self._sensors[sensor.name], self._fresh[sensor.name] = value, fresh

    def run(self, start: int, stop: int) -> None:
        """Compute the values of ops `start` up to, and not including, `stop`."""
        values, steps = self.values, self._steps
        for i in range(start, stop):
            values[i] = steps[i]()
        if start == 0:
            self._call_python()

    def decided(self, actuator: str, decided: Decided) -> None:
        """Take a decision in, for the ops that depend on it and for the records."""
        self._decided[actuator] = decided
        self._records += decided.records

    def commit(self) -> None:
        """Let memory move on to the next frame."""
        values = self.values
        moved = [(i, values[cell.value]) for i, cell in enumerate(self.code.cells) if values[cell.condition]]
        for i, value in moved:
            self.cells[i] = value

    def records(self) -> tuple[Record, ...]:
        return tuple(Record(kind, subject) for kind, subject in self._records)  # type: ignore[arg-type]

    def _step(self, op: Op) -> Step:
        """What computes the value of an op, from the values before it and from what the frame brought."""
        values = self.values
        match op:
            case Apply(operator=operator, arguments=arguments):
                return _applied(FUNCTIONS[operator], arguments, values)
            case SensorElement(sensor=sensor, index=index):
                sensors = self._sensors
                if sensor in self._arrays:
                    return lambda: sensors[sensor][index]
                return lambda: sensors[sensor]
            case Literal(value=value):
                return lambda: value
            case OldCell(cell=cell):
                return lambda: self.cells[cell]
            case SensorFresh(sensor=sensor):
                fresh = self._fresh
                return lambda: fresh[sensor]
            case FrameTime():
                return lambda: self._t
            case Table(elements=elements):
                return lambda: tuple([values[i] for i in elements])
            case _:
                return self._outside(op)

    def _outside(self, op: Op) -> Step:
        """The same for an op that depends on Python modules, on other clients, or on decisions."""
        decided = self._decided
        match op:
            case PythonActive(module=module):
                return lambda: self._answer(module)[0]
            case PythonField(module=module, index=index):
                return lambda: self._answer(module)[1][index]
            case OutsideActive(module=module):
                return lambda: bool(self._active[module])
            case Lost(module=module):
                return lambda: module in self._lost
            case Winner(actuator=actuator, module=module):
                return lambda: decided[actuator].by == module
            case Commanded(actuator=actuator):
                return lambda: decided[actuator].by is not None and decided[actuator].fault is None
            case Sent(actuator=actuator, index=index):
                return lambda: 0.0 if (sent := decided[actuator].sent) is None else sent[index]
            case _:
                raise AssertionError(f"{op} depends on nothing outside")

    def _call_python(self) -> None:
        """Call the Python modules in order, once a frame: at the first op that needs one, or after all."""
        values = self.values
        for call in self.code.python:
            if call.module in self._answers:
                continue
            given: dict[str, object] | None = None
            if values[call.present]:
                given = {
                    read.name: tuple([values[i] for i in read.elements])
                    if read.array
                    else values[read.elements[0]]
                    for read in call.reads
                }
            active, fields, self._records = self.python[call.module].step(self._t, given, self._records)
            self._answers[call.module] = (active, fields)

    def _answer(self, module: str) -> tuple[bool, tuple[ScalarValue, ...]]:
        """The Python module's command in this frame."""
        if module not in self._answers:
            self._call_python()
        return self._answers[module]


def _applied(function: Callable[..., Any], arguments: tuple[int, ...], values: list[Any]) -> Step:
    """An operator of earlier values."""
    match arguments:
        case (one,):
            return lambda: function(values[one])
        case (left, right):
            return lambda: function(values[left], values[right])
        case _:
            return lambda: function(*[values[i] for i in arguments])


def build(call: PythonCall) -> PythonStep:
    """Import and build the class of a Python module.

    Raises:
        Failure: that did not work; the error says why.
    """
    try:
        made = getattr(import_module(call.module_path), call.class_name)(**dict(call.params))
    except (Exception, SystemExit) as problem:
        path = f"{call.module_path}:{call.class_name}"
        message = f"`{path}` cannot be imported and built: {type(problem).__name__}: {problem}"
        hint = "it is looked for beside the behavior and in this folder; its params are given by keyword"
        raise Failure([error("P001", call.span, message, hint)]) from problem
    return PythonStep(call.module, made, field_types(call), call.rate_ns)


def field_types(call: PythonCall) -> tuple[tuple[str, object], ...]:
    """The fields of a Python module's command, as `PythonStep` takes them."""
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
