"""The encoding held against the reference interpreter, frame by frame.

Sensors, time and Python answers of a trace are put into the formulas; then everything that the interpreter
computed must be what the formulas say: exactly where nothing is inexact, within what rounding leaves open
elsewhere; and all assumptions, definitions and invariants must hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from colony.ir.expression import Expression
from colony.ir.frame import Frame
from colony.ir.program import Module, Program, Sensor
from colony.ir.types import Array, Enum, ScalarValue, Value, element_type
from colony.verify.reference.expressions import FrameValues
from colony.verify.reference.interpreter import Interpreter
from colony.verify.reference.kleene import Known as Known3
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.logic import is_false
from colony.verify.symbolic.system import ExtendedReal, Inexact, Scalar, System, Term
from colony.verify.symbolic.unrolling import reasons_of
from tests.verify.symbolic import term_values
from tests.verify.symbolic.term_values import Known, OpenTermError, Real, Values


@dataclass(slots=True)
class Tally:
    """How much was compared."""

    exact: int = 0
    within: int = 0
    open: int = 0
    differences: list[str] = field(default_factory=list)


class Recording(Interpreter):
    """An interpreter that remembers what contracts and limits were in the last frame."""

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        self.asked: dict[int, Known3] = {}

    def value_of(self, expression: Expression) -> Known3:
        value = self.asked[id(expression)] = super().value_of(expression)
        return value


def held_against(program: Program, trace: Sequence[Frame]) -> Tally:
    """Run `trace` in both."""
    return Trust(program).run(trace)


class Trust:
    """Holds one encoding against the interpreter, in any number of traces."""

    def __init__(self, program: Program, system: System | None = None) -> None:
        self.program = program
        self.system = encode(program) if system is None else system
        self.terms = term_values.Program(self.system)
        self.exact: dict[tuple[int, ...], bool] = {}

    def run(self, trace: Sequence[Frame]) -> Tally:
        run = _Run(self)
        for i, frame in enumerate(trace):
            run.interpreter.step(frame)
            run.frame(i)
        return run.tally

    def is_exact(self, x: Scalar) -> bool:
        """Whether nothing that `x` depends on is inexact; what Python answers is given here."""
        terms = (x.value, x.nan, x.infinite) if isinstance(x, ExtendedReal) else (x,)
        key = tuple(t.get_id() for t in terms)
        if key not in self.exact:
            reasons = reasons_of(self.system, *terms)
            self.exact[key] = all(r.kind is Inexact.PYTHON for r in reasons)
        return self.exact[key]


class _Run:
    def __init__(self, trust: Trust) -> None:
        self.trust = trust
        self.program = trust.program
        self.system = trust.system
        self.interpreter = Recording(self.program)
        self.tally = Tally()
        self.holds = {a.name: a.idle is None for a in self.program.robot.actuators}
        self.cells: dict[int, Known | OpenTermError] = {}
        initial = Values(trust.terms, {})
        for cell in self.system.cells:
            self.cells[cell.old.get_id()] = initial.any(cell.initial)

    def frame(self, i: int) -> None:
        values = Values(self.trust.terms, self.cells | self._inputs())
        self._compare(i, values)
        for formulas, name in (
            (self.system.assumptions, "assumption"),
            (self.system.definitions, "definition"),
            (self.system.invariants, "invariant"),
        ):
            for formula in formulas:
                try:
                    if not values.truth(formula):
                        self.tally.differences.append(f"frame {i}: {name} {formula}")
                except OpenTermError:
                    pass
        after: dict[int, Known | OpenTermError] = {}
        for cell in self.system.cells:
            try:
                after[cell.old.get_id()] = values.any(cell.next)
            except OpenTermError as found:
                after[cell.old.get_id()] = found
        self.cells = after

    # --- inputs ----------------------------------------------------------------------------------

    def _inputs(self) -> dict[int, Known | OpenTermError]:
        frame_values = self.interpreter._moment
        assert frame_values is not None
        given: dict[int, Known | OpenTermError] = {
            self.system.now.get_id(): Real(Fraction(frame_values.t_ns - frame_values.first_ns)),
            self.system.restarted.get_id(): frame_values.restarted,
        }
        for sensor in self.program.robot.sensors:
            terms = self.system.sensors[sensor.name]
            there = sensor.name in frame_values.fresh
            given[terms.present.get_id()] = there
            value = frame_values.sensors[sensor.name] if there else _meaningless(sensor)
            for x, v in zip(terms.elements, value if isinstance(value, tuple) else (value,), strict=True):
                given.update(_assigned(x, v))
        for name, answer in self.system.python.items():
            command = frame_values.commands.get(name)
            given[answer.answers.get_id()] = command is not None
            given[answer.blind.get_id()] = self.interpreter.is_blind(name)
            for x, field_ in zip(answer.fields, command or (0.0,) * len(answer.fields), strict=True):
                given.update(_assigned(x, field_ if command or isinstance(x, ExtendedReal) else False))
        return given

    # --- comparing -------------------------------------------------------------------------------

    def _compare(self, i: int, values: Values) -> None:
        frame_values = self.interpreter._moment
        assert frame_values is not None
        system = self.system
        for name, (missing, term) in system.derived.items():
            self._same(f"frame {i}: {name} is missing", values, missing, name not in frame_values.derived)
            if name in frame_values.derived:
                self._same(f"frame {i}: {name}", values, term, frame_values.derived[name])
        for name, term in system.locals.items():
            if name in frame_values.locals:
                self._same(f"frame {i}: {name}", values, term, frame_values.locals[name])
        for name, state in system.states.items():
            self._same(f"frame {i}: state {name}", values, state, frame_values.states[name])
        for module in self.program.modules:
            terms = system.modules[module.name]
            if isinstance(module, Module) and module.lets:
                silent = module.lets[0].name not in frame_values.locals
                self._same(f"frame {i}: {module.name} is silent", values, terms.silent, silent)
            if module.name in frame_values.commands:
                command = frame_values.commands[module.name]
                self._same(f"frame {i}: {module.name} command", values, terms.command, command)
        for name, active in system.active.items():
            self._same(f"frame {i}: {name} is active", values, active, frame_values.outputs[name] is not None)
        self._compare_actuators(i, values, frame_values)
        for contract, claim in zip(self.program.contracts, system.claims, strict=True):
            holds = self.interpreter.asked[id(contract.expression)] is True
            self._same(f"frame {i}: {claim.name} holds", values, claim.holds, holds)

    def _compare_actuators(self, i: int, values: Values, frame_values: FrameValues) -> None:
        for name, actuator in self.system.actuators.items():
            for module_name, wins in actuator.wins.items():
                self._same(
                    f"frame {i}: {name} by {module_name}",
                    values,
                    wins,
                    frame_values.winners[name] == module_name,
                )
            if frame_values.winners[name] is not None:
                assert frame_values.winners[name] in actuator.wins, f"{frame_values.winners[name]} wins"
            commanded = name in frame_values.commanded
            self._same(f"frame {i}: {name} is commanded", values, actuator.commanded, commanded)
            for j, sent in enumerate(actuator.sent):
                if (name, j) in frame_values.sent and (commanded or not self.holds[name]):
                    self._same(f"frame {i}: {name}.{j} sent", values, sent, frame_values.sent[name, j])

    def _same(self, what: str, values: Values, term: Term, expected: Value) -> None:
        if isinstance(term, tuple):
            assert isinstance(expected, tuple)
            for x, v in zip(term, expected, strict=True):
                self._same(what, values, x, v)
            return
        assert not isinstance(expected, tuple)
        exact = self.trust.is_exact(term)
        try:
            found = values.scalar(term)
        except OpenTermError:
            self.tally.open += 1
            if exact:
                self.tally.differences.append(f"{what}: open, though nothing in it is inexact")
            return
        if exact:
            self.tally.exact += 1
        else:
            self.tally.within += 1
        if not _agrees(found, expected):
            self.tally.differences.append(f"{what}: {found}, but the interpreter has {expected!r}")
        elif exact and isinstance(found, Real) and found.error:
            self.tally.differences.append(f"{what}: rounded, though nothing in it is inexact")


def _agrees(found: bool | float | Real, expected: ScalarValue) -> bool:
    match found:
        case bool():
            return found is bool(expected)
        case float():
            return found == expected or (math.isnan(found) and math.isnan(expected))
        case Real(value=value, error=error):
            return math.isfinite(expected) and abs(value - Fraction(expected)) <= error


def _assigned(x: Scalar, value: ScalarValue) -> dict[int, Known | OpenTermError]:
    """The constants of an input that has a value."""
    if not isinstance(x, ExtendedReal):
        return {x.get_id(): bool(value)}
    given: dict[int, Known | OpenTermError] = {}
    sign = Fraction(0 if math.isnan(value) else 1 if value > 0 else -1)
    given[x.value.get_id()] = Real(Fraction(value) if math.isfinite(value) else sign)
    for term, holds in ((x.nan, math.isnan(value)), (x.infinite, math.isinf(value))):
        if not is_false(term):
            given[term.get_id()] = holds
    return given


def _meaningless(sensor: Sensor) -> Value:
    """A value that the sensor could have, where it is missing: nothing may depend on it."""
    of = element_type(sensor.type)
    one: ScalarValue = True
    if isinstance(of, Enum):
        one = of.members[-1][1]
    elif str(of) != "bool":
        one = sensor.high if sensor.high is not None else sensor.low if sensor.low is not None else 1234.5
    return (one,) * sensor.type.size if isinstance(sensor.type, Array) else one
