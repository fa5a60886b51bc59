"""Execution of a program's examples (its `test` blocks) in the reference interpreter.

An example fails if an expectation is false, if an expectation is unknown because it reads something
missing, or if a contract is broken in any frame.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, assert_never

from colony.ir import expression as ir
from colony.ir import frame
from colony.ir.frame import Decision, Outcome
from colony.ir.program import (
    Actuator,
    AnyModule,
    Contract,
    Example,
    ExampleStep,
    GivenReading,
    Let,
    Module,
    Program,
    PythonModule,
    Use,
    Wiring,
)
from colony.ir.types import (
    Array,
    Bool,
    Enum,
    Quantity,
    Scalar,
    ScalarValue,
    Type,
    Value,
    element_type,
    unit_shown,
)
from colony.text.diagnostics import Diagnostic, Label, error
from colony.text.source import Span
from colony.text.units import parse_unit
from colony.text.wording import counted, duration_text, listed, quoted
from colony.verify.claims import source_text
from colony.verify.reference.boundary import default_of
from colony.verify.reference.interpreter import Interpreter
from colony.verify.reference.kleene import is_known
from colony.verify.snapshot import Snapshot, sparse_text
from colony.verify.testing.frames import GivenReadings

# --- silence ------------------------------------------------------------------------------------------
#
# Reasons why modules are silent or blind in a frame, and derived values missing.

_MAX_CANDIDATES = 100
"""Maximum number of silent or blind modules of a frame that are considered."""


class Silence:
    """The values that are missing in the last frame of an interpreter, and the modules without an answer.

    `missing` has each missing sensor, and the reason if it is too old: `too old (350 ms)`.
    """

    def __init__(self, program: Program, interpreter: Interpreter, missing: Mapping[str, str]) -> None:
        self._program, self._interpreter, self._sensors = program, interpreter, missing
        self._lets: dict[str, tuple[str, ...]] = {}  # the missing sensors that each let needs
        for let in program.derived:
            if isinstance(let, Let):
                self._lets[let.name] = tuple(self._sensors_of(_needed(let.expression)))

    def text(self, name: str) -> str | None:
        """Return why a sensor or a let of a file is missing; None if it is not."""
        if name in self._sensors:
            return self._absent([name])
        sensors = self._lets.get(name)
        if not sensors:
            return None
        if any(self._sensors[sensor] for sensor in sensors):
            return f"`{name}` is missing since {self._absent(sensors)}"
        return f"`{name}` is missing since {quoted(sensors)} {'are' if len(sensors) > 1 else 'is'}"

    def missing_in(self, expression: ir.Expression) -> tuple[str, ...]:
        """Return the missing sensors that an expression needs, itself or by way of lets of files."""
        return tuple(self._sensors_of(_needed(expression)))

    def reasons(self, expression: ir.Expression) -> Iterator[str]:
        """Yield why modules are silent or blind that an expectation names, or that would change it."""
        named = set(_modules_named(expression))
        candidates = [m for m in self._program.modules if self._state(m.name)]
        candidates = sorted(candidates, key=lambda m: m.name not in named)[:_MAX_CANDIDATES]
        active = {m.name for m in self._program.modules if self._interpreter.is_active(m.name)}
        before = _outputs(self._program, active) if candidates else {}
        for module in candidates:
            after = {} if module.name in named else _outputs(self._program, active ^ {module.name})
            if module.name in named or _differs(expression, before, after):
                yield f"`{module.name}` is {self._state(module.name)}: {self._reason(module)}"

    def _state(self, module: str) -> str:
        if self._interpreter.is_silent(module):
            return "silent"
        return "blind" if self._interpreter.is_blind(module) else ""

    def _reason(self, module: AnyModule) -> str:
        needed = dict.fromkeys(leaf for e in _evaluated(module) for leaf in _needed(e))
        sensors = [name for name in needed if name in self._sensors and " " not in name]
        lets = [text for name in needed if name in self._lets and (text := self.text(name))]
        return ", ".join([*([self._absent(sensors)] if sensors else []), *lets]) or "it has no answer"

    def _sensors_of(self, names: Iterable[str]) -> dict[str, None]:
        """Return the missing sensors among names, and those that the lets among them need."""
        found: dict[str, None] = {}
        for name in names:
            found |= dict.fromkeys((name,) if name in self._sensors else self._lets.get(name, ()))
        return found

    def _absent(self, sensors: Sequence[str]) -> str:
        """Return `a and b are missing and c is too old (350 ms)`."""
        gone = [name for name in sensors if not self._sensors[name]]
        parts = [f"{quoted(gone)} {'are' if len(gone) > 1 else 'is'} missing"] if gone else []
        parts += [f"`{name}` is {self._sensors[name]}" for name in sensors if self._sensors[name]]
        return listed(parts)


def _needed(e: ir.Expression) -> Iterator[str]:
    """Yield the sensors and the lets of files that an expression needs."""
    match e:
        case ir.SensorValue(name=name) | ir.DerivedValue(name=name):
            yield name
        case ir.ValueOr(other=other):
            yield from _needed(other)
        case _:
            for child in ir.children(e):
                yield from _needed(child)


def _evaluated(module: AnyModule) -> tuple[ir.Expression, ...]:
    """Return what a module evaluates in every frame."""
    match module:
        case Module():
            lets = (let.expression for let in module.lets)
            updates = (state.next for state in module.states if state.next is not None)
            return (*lets, module.when, *(module.command.fields if module.command else ()), *updates)
        case PythonModule():
            return tuple(reading.expression for reading in module.reads)
        case _:
            assert_never(module)


def _modules_named(expression: ir.Expression) -> Iterator[str]:
    for leaf in ir.subexpressions(expression):
        match leaf:
            case ir.WonBy(module=name) | ir.IsActive(name=name):
                yield name
            case ir.LocalValue(name=name):
                yield name.rpartition(".")[0]
            case _:
                pass


# --- the network without its time constants --------------------------------------------------------


_Outputs = Mapping[str, str | None]
"""The module whose output gets through, by module, wire or actuator; None if none does."""


def _outputs(program: Program, active: Collection[str]) -> _Outputs:
    """Return what gets through if these modules are active."""
    outputs = {m.name: m.name if m.name in active else None for m in program.modules}
    for wire in program.wires:
        outputs[wire.actuator or wire.name] = _output(wire.wiring, outputs)
    return outputs


def _differs(expression: ir.Expression, a: _Outputs, b: _Outputs) -> bool:
    """Return True if an expression reads a winner, or the activity of a wire, that differs."""
    for leaf in ir.subexpressions(expression):
        match leaf:
            case (
                ir.SentField(actuator=name)
                | ir.WonBy(actuator=name)
                | ir.IsCommanded(actuator=name)
                | ir.IsIdle(actuator=name)
            ):
                if a.get(name) != b.get(name):
                    return True
            case ir.IsActive(name=name):
                if (a[name] is None) != (b[name] is None):
                    return True
            case _:
                pass
    return False


def _output(wiring: Wiring, outputs: _Outputs) -> str | None:
    if isinstance(wiring, Use):
        return outputs[wiring.name]
    *dominant, last = wiring.operands
    result = _output(last, outputs)
    for operand in reversed(dominant):
        winner = _output(operand, outputs)
        if winner is not None:
            result = winner if wiring.relation == "suppresses" else None
    return result


# --- examples -----------------------------------------------------------------------------------------

FailureKind = Literal[
    "false", "unknown", "contract broken", "contract unknown", "no array to set an element in"
]

_CODES: dict[FailureKind, str] = {
    "false": "T001",
    "unknown": "T002",
    "contract broken": "T003",
    "contract unknown": "T003",
    "no array to set an element in": "T004",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExampleFailure:
    """A failed expectation or contract of an example, at the first frame in which it fails.

    `expected` is the condition as written (a contract with its name); `found` lists the actual values, one
    fact per line; `hint` is how to mend it, if that is known. `frames` is the number of frames of the step
    (of the example, for a contract) with this failure.
    """

    kind: FailureKind
    span: Span
    t_ns: int
    expected: str
    found: tuple[str, ...]
    hint: str | None = None
    frames: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ExampleResult:
    """The result of an example; it passed if nothing failed. `frames` is its number of frames.

    `assumptions` has the number of frames that broke each assumption, of those that were broken.
    """

    name: str
    span: Span
    failures: tuple[ExampleFailure, ...]
    frames: int
    assumptions: Mapping[str, int]

    @property
    def passed(self) -> bool:
        """True if nothing failed."""
        return not self.failures


def run_examples(program: Program, only: Collection[str] = ()) -> tuple[ExampleResult, ...]:
    """Run every example of `program`, each from the program's initial memory, in the order written.

    With `only`, run only the examples whose names contain one of these texts.
    """
    chosen = (e for e in program.tests if not only or any(text in e.name for text in only))
    return tuple(run_example(program, example) for example in chosen)


def run_example(program: Program, example: Example) -> ExampleResult:
    """Run one example of `program`, from the program's initial memory."""
    run = _Run(program)
    for step in example.steps:
        run.step(step)
    return ExampleResult(
        name=example.name,
        span=example.span,
        failures=tuple(run.failures.values()),
        frames=run.frames,
        assumptions=dict(run.broken_assumptions),
    )


class BreachFacts(NamedTuple):
    """The frame of a run that breaks a contract.

    The contract is false there or, if `unknown`, unknown because it reads something missing. `found` has the
    values that it reads, one fact each.
    """

    unknown: bool = False
    found: tuple[str, ...] = ()


def facts_of_breach(program: Program, contract: str, snapshots: Iterable[Snapshot]) -> BreachFacts:
    """Return the facts of the first frame of a run that breaks a contract; none if no frame does."""
    names = [s.name for s in program.robot.sensors]
    sent = {s.name for s in program.robot.sensors if s.sent is not None}
    run = _Run(replace(program, contracts=tuple(c for c in program.contracts if c.name == contract)))
    for snapshot in snapshots:
        readings = tuple(
            GivenReading(sensor=n, index=None, value=snapshot.readings.get(n))
            for n in names
            if n in snapshot.readings or n not in sent
        )
        step = ExampleStep(
            times_ns=(snapshot.t_ns,), given=readings, expectations=(), restarted=snapshot.restarted
        )
        run.step(step, snapshot.lost, snapshot.given)
    broken = {"contract broken": False, "contract unknown": True}
    failures = run.failures.values()
    facts = (BreachFacts(broken[f.kind], f.found) for f in failures if f.kind in broken)
    return next(facts, BreachFacts())


def failures_as_diagnostics(results: Iterable[ExampleResult]) -> tuple[Diagnostic, ...]:
    """Return an error for each failure.

    T001: false; T002: no value; T003: a broken contract; T004: an element of a missing array was set.
    """
    return tuple(_diagnostic(result, failure) for result in results for failure in result.failures)


def _diagnostic(result: ExampleResult, failure: ExampleFailure) -> Diagnostic:
    when = f'in "{result.name}" at {_number(failure.t_ns / 1e9)} s'
    repeated = f", and in {counted(failure.frames - 1, 'more frame')}" if failure.frames > 1 else ""
    match failure.kind:
        case "false":
            message = f"{when}{repeated}: expected `{failure.expected}`"
        case "unknown":
            message = f"{when}{repeated}: `{failure.expected}` is unknown"
        case "contract broken":
            message = f"{when}{repeated}: contract {failure.expected} is false"
        case "contract unknown":
            message = f"{when}{repeated}: contract {failure.expected} is unknown"
        case "no array to set an element in":
            message = f"{when}: `{failure.expected}` is missing, so none of its elements can be set"
        case _:
            assert_never(failure.kind)
    found = "; ".join(failure.found)
    message = f"{message}; found: {found}" if found else message
    is_elsewhere = failure.span.source is not result.span.source
    test = (Label(result.span, "in this test"),) if is_elsewhere else ()
    return error(_CODES[failure.kind], failure.span, message, failure.hint, *test)


class _Run:
    """An example being run. Stateful: remembers the readings given so far, and the failures."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.interpreter = Interpreter(program)
        self.sensors = {s.name: s for s in program.robot.sensors}
        self.readings = GivenReadings(program)
        self.failures: dict[object, ExampleFailure] = {}
        self.frames = 0
        self.broken_assumptions = Counter[str]()

    def step(
        self,
        step: ExampleStep,
        lost: frozenset[str] = frozenset(),
        commands: Mapping[str, frame.OverriddenCommand] = frame.NOTHING_GIVEN,
    ) -> None:
        """Run a step; `lost` and `commands` are `lost` and `given` of `Interpreter.step`."""
        for given in step.given:
            self.give(given, step.times_ns[0])
        for number, t_ns in enumerate(step.times_ns):
            readings, restarted = self.readings.at(t_ns), step.restarted and number == 0
            outcome = self.interpreter.step_in_base_units(t_ns, readings, lost, commands, restarted=restarted)
            self.frames += 1
            for contract in self.program.contracts:
                if contract.name not in outcome.breaches:
                    continue
                if contract.is_assumption:
                    self.broken_assumptions[contract.name] += 1
                elif not contract.assumed:
                    self.broken(contract, t_ns, outcome)
            for i, expectation in enumerate(step.expectations):
                self.expect(expectation, (id(step), i), t_ns, outcome)

    def give(self, given: GivenReading, t_ns: int) -> None:
        """Apply an assignment, which holds until the sensor is assigned again."""
        if self.readings.give(given, t_ns):
            return
        sensor = self.sensors[given.sensor]
        has_default = default_of(sensor) is not None
        hint = f"assign the whole array first: `{sensor.name} = ...`" + (
            "; the sensor's default does not count" if has_default else ""
        )
        self.fail("no array to set an element in", given, given.span, t_ns, sensor.name, (), hint)

    def expect(self, expectation: ir.Expression, key: object, t_ns: int, outcome: Outcome) -> None:
        value = self.interpreter.value_of(expectation)
        if value is not True:
            kind: FailureKind = "unknown" if value is None else "false"
            found = self.found((key, kind), expectation, t_ns, outcome)
            self.fail(kind, (key, kind), expectation.span, t_ns, source_text(expectation), found)

    def broken(self, contract: Contract, t_ns: int, outcome: Outcome) -> None:
        text = source_text(contract.expression)
        expected = f"`{contract.name}: {text}`" if text else f"`{contract.name}`"
        unknown = self.interpreter.is_unknown(contract.name)
        kind: FailureKind = "contract unknown" if unknown else "contract broken"
        key = (contract.name, kind)
        found = self.found(key, contract.expression, t_ns, outcome)
        hint = self.missing_hint(contract, t_ns) if unknown and found else None
        self.fail(kind, key, contract.span, t_ns, expected, found, hint)

    def missing_hint(self, contract: Contract, t_ns: int) -> str | None:
        """Return how to mend a contract that is unknown because sensors are missing."""
        silence = Silence(self.program, self.interpreter, self.missing_sensors(t_ns))
        missing = [s for s in silence.missing_in(contract.expression) if self.sensors[s].sent is None]
        if not missing:
            return None
        return (
            f"give {quoted(missing)} in the test, or say in the contract what a missing one stands for: "
            f"`value_or({missing[0]}, ...)`"
        )

    def fail(
        self,
        kind: FailureKind,
        key: object,
        span: Span,
        t_ns: int,
        expected: str,
        found: tuple[str, ...],
        hint: str | None = None,
    ) -> None:
        """Record a failure, or count it if it occurred in an earlier frame."""
        before = self.failures.get(key)
        if before is None:
            before = ExampleFailure(
                kind=kind, span=span, t_ns=t_ns, expected=expected, found=found, hint=hint, frames=0
            )
        self.failures[key] = replace(before, frames=before.frames + 1)

    # --- actual values ---------------------------------------------------------------------------

    def found(self, key: object, expression: ir.Expression, t_ns: int, outcome: Outcome) -> tuple[str, ...]:
        """Return a fact for each name in `expression`, each once; reasons of silence; and a fact a record.

        A failure that is recorded already gets none.
        """
        if key in self.failures:
            return ()
        silence = Silence(self.program, self.interpreter, self.missing_sensors(t_ns))
        facts = dict.fromkeys(
            fact
            for leaf in ir.subexpressions(expression)
            for fact in self.fact(leaf, outcome, silence)
            if fact
        )
        records = [
            f"recorded: {record.kind} of {record.subject}"
            for record in outcome.records
            if record.kind not in ("limited", "command clamped", "missing")
        ]
        return (*facts, *silence.reasons(expression), *records)

    def missing_sensors(self, t_ns: int) -> dict[str, str]:
        """Return the missing sensors, each with its age if it is missing because it is too old."""
        missing: dict[str, str] = {}
        for sensor in self.program.robot.sensors:
            if self.readings.value_at(sensor.name, t_ns) is None and default_of(sensor) is None:
                age_ns = self.readings.age_if_old(sensor.name, t_ns)
                missing[sensor.name] = "" if age_ns is None else f"too old ({duration_text(age_ns)})"
        return missing

    def fact(self, leaf: ir.Expression, outcome: Outcome, silence: Silence) -> Iterator[str]:
        match leaf:
            case ir.SensorValue(name=name) | ir.DerivedValue(name=name) if text := silence.text(name):
                yield text
            case (
                ir.SentField(actuator=actuator)
                | ir.WonBy(actuator=actuator)
                | ir.IsCommanded(actuator=actuator)
                | ir.IsIdle(actuator=actuator)
            ):
                yield self.decided(actuator, outcome)
            case (
                ir.SensorValue(name=name)
                | ir.DerivedValue(name=name)
                | ir.LocalValue(name=name)
                | ir.StateValue(name=name)
            ):
                value = self.interpreter.value_of(leaf)
                unit = self.sensors[name].unit if isinstance(leaf, ir.SensorValue) else ""
                yield f"{name} = {shown(value, leaf.type, unit)}" if is_known(value) else f"{name} is missing"
            case ir.Fresh(name=name):
                yield f"{name} is {'' if self.interpreter.value_of(leaf) else 'not '}fresh"
            case ir.RestartedFlag():
                yield "restarted" if self.interpreter.value_of(leaf) else "not restarted"
            case ir.IsActive(name=name):
                yield f"{name} is {'' if self.interpreter.value_of(leaf) else 'not '}active"
            case _:
                return

    def decided(self, name: str, outcome: Outcome) -> str:
        """Return `drive by cruise, velocity = 300 mm/s`."""
        actuator = next(a for a in self.program.robot.actuators if a.name == name)
        decision = next(d for d in outcome.decisions if d.actuator == name)
        commanded = name in self.interpreter.values.commanded
        return ", ".join((f"{name} {_decider(decision, commanded)}", *self.sent(actuator)))

    def sent(self, actuator: Actuator) -> Iterator[str]:
        for i, field in enumerate(actuator.fields):
            value = self.interpreter.value_of(
                ir.SentField(type=field.type, actuator=actuator.name, field_index=i)
            )
            if is_known(value):
                yield f"{field.name} = {shown(value, field.type, field.unit)}"
            else:
                yield "nothing sent so far"
                return


def _decider(decision: Decision, commanded: bool) -> str:
    if decision.by is None:
        return "by an operator" if commanded else "is idle"
    return f"by {decision.by}" + (f" ({decision.fault})" if decision.fault else "")


# --- the text of values --------------------------------------------------------------------------

_MAX_ELEMENTS = 8


def shown(value: Value, type_: Type, unit: str = "") -> str:
    """Return the text of a value in this unit (or the base unit), or the name of an enumerator.

    Long arrays are abridged: `all 5 m, [0 deg] 0.4 m`, or the first elements if many differ.
    """
    if not isinstance(value, tuple):
        return _scalar(value, element_type(type_), unit)
    assert isinstance(type_, Array)
    if len(value) > _MAX_ELEMENTS:
        text = sparse_text(value, type_, lambda x: _scalar(x, type_.element, unit))
        if text is not None:
            return text
    parts = [_scalar(x, type_.element, unit) for x in value[:_MAX_ELEMENTS]]
    return f"[{', '.join(parts)}{', ...' if len(value) > _MAX_ELEMENTS else ''}]"


def _scalar(value: ScalarValue, type_: Scalar, unit: str) -> str:
    match type_:
        case Bool():
            return "true" if value else "false"
        case Enum(name=name, members=members):
            return next((f"{name}.{member}" for member, n in members if n == value), _number(value))
        case Quantity() as quantity:
            of = parse_unit(unit) if unit else unit_shown(quantity)
            text = _number(value / float(of.factor))
            return text if of.text == "number" else f"{text} {of.text}"
        case _:
            assert_never(type_)


def _number(x: float) -> str:
    """Return a number with up to 9 significant digits."""
    return f"{x:.9g}"
