"""Margins: how wrong, how late and how rare the readings of a sensor may be before a contract falls.

A contract, and what the program assumes, speak of the true readings; the program sees others. So it is
changed: modules, limits and derived values read a let in the place of the sensor, which is missing where the
sensor is, and contracts read copies of the lets of files that are computed from the sensor itself. States,
machines, and members of modules are those of the program. Readings are

- **wrong** by at most E: each number is `true + e` within the sensor's range, with free `e` in -E .. E; an
  angle with a range of a full circle goes around it;
- **late** by up to N: any of the present reading and the N before it, in each frame;
- **rare**: the sensor is read at least every N-th time, and stands in between.

Each of them includes those that are smaller, so a margin can be bisected. All are proofs, or runs, of a
program like any other: no part of the prover knows of margins.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from itertools import count
from typing import Any, Literal, NamedTuple, TypeVar, assert_never, cast

from colony.dsl.check.compatibility import with_new_cells
from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression, TypedNode, rebuilt
from colony.ir.program import Contract, Derived, Let, Program, Sensor, State, assumptions, without_assumed
from colony.ir.types import BOOL, DIMENSIONLESS, Quantity, ScalarValue, any_value, element_type
from colony.ir.walk import all_subexpressions
from colony.record import Record
from colony.text.units import ANGLE
from colony.text.wording import counted
from colony.verify.claims import TRUE, all_of, any_of, binary, constant, fresh, present
from colony.verify.contracts.assumptions import under
from colony.verify.contracts.prove import ContractProver, explained
from colony.verify.contracts.results import ProofOptions, Proved, ProvedInTime, Refuted, Result, Trace
from colony.verify.contracts.slicing import needs_of_slices, slice_of
from colony.verify.contracts.solver import Deadline
from colony.verify.contracts.table import rounded

Kind = Literal["wrong", "late", "rare"]

MAX_READINGS = 16
"""The largest number of readings by which a sensor is late, or of which one is taken, that is asked for."""

_DIGITS = (1, 2, 3)
"""Significant digits of the errors that are tried, in the unit of the sensor."""

_CLOSE = 0.05
"""An error that is proved and one that is refuted are not bisected if they are as close as this share."""

_LEAST = 1e-4
_LARGE = 1e6
"""The least error that is bisected, as a share of the range, and the largest in units, without a range."""


class Margin(NamedTuple):
    """A margin of a contract: the readings of a sensor may be so wrong (in base units), late or rare.

    Attributes:
        contract: the contract.
        sensor: the sensor.
        kind: what is asked of its readings.
        proved: the largest amount for which the contract is proved: at least an error of 0, late by 0
            readings, and each reading taken.
        refuted: the smallest for which a run is known that breaks it; None if none is known.
        program: the program of which `trace` is a run.
        trace: that run; its readings are the true ones.
        is_complete: False if the limit was reached before.
    """

    contract: Contract
    sensor: Sensor
    kind: Kind
    proved: float
    refuted: float | None = None
    program: Program | None = None
    trace: Trace | None = None
    is_complete: bool = True


def margins(
    program: Program,
    results: list[Result],
    options: ProofOptions,
    deadline: Deadline,
) -> Iterator[Margin]:
    """Yield the margins of contracts that are proved, where a sensor matters: contract by contract.

    A sensor of which any other reading would do has no margin. The proofs are about runs in which every
    client is in time and no assumption of the program is broken.
    """
    assumed = tuple(a.name for a in assumptions(program))
    proved = [r for r in results if isinstance(r, Proved | ProvedInTime) and not r.contract.reach]
    for number, result in enumerate(proved):
        contract = replace(result.contract, assuming=assumed)
        deadline.begin_part(len(proved) - number, contract.name)
        deadline.begin_stage("true readings")
        if not isinstance(_prove(program, contract, options, deadline), Proved):
            continue
        assuming = under(program, contract.assuming)
        values = needs_of_slices(assuming)[contract.name].values
        for sensor in program.robot.sensors:
            if sensor.name in values and sensor.of_robot:
                yield from _MarginSearch(program, contract, sensor, options, deadline).margins()


class _MarginSearch:
    """The search for the margins of one contract and sensor."""

    def __init__(
        self, program: Program, contract: Contract, sensor: Sensor, options: ProofOptions, deadline: Deadline
    ) -> None:
        self._program, self._contract, self._sensor = program, contract, sensor
        self._options, self._deadline = options, deadline

    def margins(self) -> Iterator[Margin]:
        """Yield a margin of each kind; none if the contract is proved whatever the sensor reads."""
        self._deadline.begin_stage(f"any {self._sensor.name}")
        if self._is_proved(with_any_reading(self._program, self._sensor)):
            return
        if isinstance(element_type(self._sensor.type), Quantity):
            yield self._margin("wrong", self._error_between)
        for kind in ("late", "rare"):
            yield self._margin(kind, self._number_between)

    def _margin(self, kind: Kind, between: Callable[[float, float | None], float | None]) -> Margin:
        """Return the margin that is found by bisecting what is proved, and then what a run breaks."""
        found = Margin(self._contract, self._sensor, kind, float(kind == "rare"))
        above: float | None = None  # the least amount that is not proved
        while not self._deadline.is_over() and (amount := between(found.proved, above)) is not None:
            found, is_proved = self._asked(found, amount)
            above = above if is_proved else amount if found.refuted is None else min(amount, found.refuted)
        below = above if above is not None else found.proved  # the largest amount that no run breaks
        while not self._deadline.is_over() and found.refuted is not None:
            refuted = found.refuted
            if below >= refuted or (amount := between(below, refuted)) is None:
                break
            found, _ = self._asked(found, amount)
            below = amount if found.refuted == refuted else below
        return found._replace(is_complete=not self._deadline.is_over())

    def _asked(self, found: Margin, amount: float) -> tuple[Margin, bool]:
        """Return the margin with what is found out about an amount, and True if that is proved."""
        text = f"{found.kind} by {amount / (self._sensor.factor if found.kind == 'wrong' else 1):g}"
        self._deadline.begin_stage(f"{self._sensor.name} {text}")
        program = with_disturbed(self._program, self._sensor, found.kind, amount)
        result = self._prove(program)
        if isinstance(result, Refuted):
            result = explained(without_assumed(program), result)
        match result:
            case Proved():
                return found._replace(proved=max(found.proved, amount)), True
            case Refuted(trace=trace):
                least = _largest_error(self._sensor, trace) if found.kind == "wrong" else amount
                return found._replace(refuted=least, program=program, trace=trace), False
            case _:
                return found, False

    def _error_between(self, low: float, high: float | None) -> float | None:
        """Return an error with few digits between two, None if they are close."""
        sensor = self._sensor
        span = None if sensor.low is None or sensor.high is None else sensor.high - sensor.low
        if high is None:
            largest = _LARGE * sensor.factor if span is None else span / 2 if _is_circle(sensor) else span
            return largest if low < largest else None
        if high - low <= max(_CLOSE * high, _LEAST * (sensor.factor if span is None else span)):
            return None
        middle = (low + high) / 2 if high < 4 * low else math.sqrt(max(low, high / 1000) * high)
        tried = (rounded(middle, sensor, digits) for digits in _DIGITS)
        return next((x for x in tried if low < x < high), None)

    def _number_between(self, low: float, high: float | None) -> float | None:
        """Return a number of readings between two, or above one within what the age of a reading allows."""
        sensor, frame_ns = self._sensor, self._program.robot.frame_ns
        most = MAX_READINGS if sensor.within_ns is None else min(MAX_READINGS, sensor.within_ns // frame_ns)
        number = min(2 * low or 1, most) if high is None else (low + high) // 2
        return number if number > low else None

    def _is_proved(self, program: Program) -> bool:
        return isinstance(self._prove(program), Proved)

    def _prove(self, program: Program) -> Result:
        """Prove the contract alone, while every client is in time."""
        return _prove(program, self._contract, self._options, self._deadline)


def _prove(program: Program, contract: Contract, options: ProofOptions, deadline: Deadline) -> Result:
    program = under(program, contract.assuming)
    contract = next(replace(c, in_time=True) for c in program.contracts if c.name == contract.name)
    program = replace(program, contracts=(contract,), tests=())
    encoded = slice_of(program, contract)
    return ContractProver(program, options, deadline, encoded=encoded).prove_disturbed(contract)


def _largest_error(sensor: Sensor, trace: Trace) -> float:
    """Return the largest error of a run, in base units."""
    errors = [s.readings.get(_error_name(sensor)) or 0.0 for s in trace.snapshots]
    return max(abs(x) for error in errors for x in (error if isinstance(error, tuple) else (error,)))


# --- text ----------------------------------------------------------------------------------------------


def amount_text(margin: Margin, amount: float | None) -> str:
    """Return an amount as the table has it: `± 0.2 m`, `late by 2 readings`, `every 3rd reading`."""
    if amount is None:
        return "-"
    match margin.kind:
        case "wrong":
            unit = f" {margin.sensor.unit}" if margin.sensor.unit else ""
            return f"± {amount / margin.sensor.factor:.6g}{unit}"
        case "late":
            return f"late by {counted(int(amount), 'reading')}"
        case "rare":
            return "every reading" if amount == 1 else f"one of {amount:g} readings"
        case _:
            assert_never(margin.kind)


def margin_lines(found: Sequence[Margin]) -> Iterator[str]:
    """Yield a table of margins."""
    rows = [("contract", "sensor", "proved to", "broken by a run from")]
    for m in found:
        above = amount_text(m, m.refuted) if m.is_complete else f"{amount_text(m, m.refuted)} (limit reached)"
        rows.append((m.contract.name, m.sensor.name, amount_text(m, m.proved), above))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


# --- programs that see other readings ------------------------------------------------------------------


def with_any_reading(program: Program, sensor: Sensor) -> Program:
    """Return the program that sees any readings of a sensor, where that has one."""
    default = any_value(element_type(sensor.type)) if sensor.low is None else sensor.low
    other = _free(sensor, "reading", default=default)
    value = ir.SensorValue(type=sensor.type, name=other.name)
    if_present = any_of((TRUE, present(_true(sensor))))
    seen = ir.Conditional(type=sensor.type, condition=if_present, yes=value, no=value)
    return _with_seen(program, sensor, seen, [other], [])


def with_disturbed(program: Program, sensor: Sensor, kind: Kind, amount: float) -> Program:
    """Return the program that sees wrong, late or rare readings of a sensor, and contracts of true ones."""
    if kind == "wrong":
        return _with_errors(program, sensor, amount)
    calls = (x.cell for x in all_subexpressions(program) if isinstance(x, ir.MemoryCall))
    cells = count(1 + max(calls, default=0))
    before: list[Expression] = [_true(sensor)]
    chain: list[Derived] = []
    for i in range(1, int(amount) + (kind == "late")):
        last = before[-1]
        previous = ir.MemoryCall(
            type=sensor.type, function=ir.MemoryFunction.PREVIOUS, arguments=(last, last), cell=next(cells)
        )
        chain.append(Let(name=f"{sensor.name} {i} before", expression=previous))
        before.append(ir.DerivedValue(type=sensor.type, name=chain[-1].name))
    name = f"{sensor.name} age"
    if kind == "late":
        free = Sensor(name=name, type=DIMENSIONLESS, low=0.0, high=amount, default=0.0, server="", field="")
        age: Expression = ir.SensorValue(type=DIMENSIONLESS, name=name)
    else:
        free = Sensor(name=f"{sensor.name} skipped", type=BOOL, default=False, server="", field="")
        skipped = ir.SensorValue(type=BOOL, name=free.name)
        age = ir.DerivedValue(type=DIMENSIONLESS, name=f"{name} now")
        chain += _skipping(sensor, name, skipped, amount)
    seen = before[0]
    for i, value in enumerate(before[1:], 1):
        is_as_old = binary(Binary.GREATER_EQUAL, age, constant(float(i), DIMENSIONLESS))
        seen = ir.Conditional(type=sensor.type, condition=is_as_old, yes=value, no=seen)
    return _with_seen(program, sensor, seen, [free], chain)


def _with_errors(program: Program, sensor: Sensor, largest: float) -> Program:
    true = _true(sensor)
    error = replace(_free(sensor, "error", default=0.0), low=-largest, high=largest)
    value = ir.SensorValue(type=sensor.type, name=error.name)
    seen: Expression = ir.BinaryOperation(type=sensor.type, operator=Binary.ADD, left=true, right=value)
    if sensor.low is not None or sensor.high is not None:
        element = element_type(sensor.type)
        low = -sys.float_info.max if sensor.low is None else sensor.low
        high = sys.float_info.max if sensor.high is None else sensor.high
        limits = (constant(low, element), constant(high, element))
        if _is_circle(sensor):
            seen = _around(seen, limits, constant(high - low, element))
        seen = ir.FunctionCall(type=sensor.type, function=ir.Function.CLAMP, arguments=(seen, *limits))
    if sensor.default is not None:  # which has no error
        seen = ir.Conditional(type=sensor.type, condition=fresh(sensor.name), yes=seen, no=true)
    return _with_seen(program, sensor, seen, [error], [])


def _is_circle(sensor: Sensor) -> bool:
    """Return True if the range of a sensor is a full circle, whose ends are one direction."""
    is_angle = isinstance(sensor.type, Quantity) and sensor.type.dimension == ANGLE
    span = None if sensor.low is None or sensor.high is None else sensor.high - sensor.low
    return is_angle and span is not None and math.isclose(span, 360.0, rel_tol=1e-9)


def _around(angle: Expression, limits: tuple[Expression, Expression], circle: Expression) -> Expression:
    """Return an angle that is beyond an end of its range by less than a circle, on its other side."""
    for limit, beyond, back in zip(
        limits, (Binary.LESS, Binary.GREATER), (Binary.ADD, Binary.SUBTRACT), strict=True
    ):
        moved = ir.BinaryOperation(type=angle.type, operator=back, left=angle, right=circle)
        condition = binary(beyond, angle, limit)
        angle = ir.Conditional(type=angle.type, condition=condition, yes=moved, no=angle)
    return angle


def _skipping(sensor: Sensor, name: str, skipped: Expression, every: float) -> Iterator[Derived]:
    """Yield how many readings ago the sensor was read, and the state that remembers it."""
    state = ir.StateValue(type=DIMENSIONLESS, name=name)
    one = constant(1.0, DIMENSIONLESS)
    older = ir.BinaryOperation(type=DIMENSIONLESS, operator=Binary.ADD, left=state, right=one)
    may_stand = binary(Binary.LESS, older, constant(every, DIMENSIONLESS))
    stands = all_of((skipped, may_stand, any_of((TRUE, present(_true(sensor))))))
    none = constant(0.0, DIMENSIONLESS)
    now = ir.Conditional(type=DIMENSIONLESS, condition=stands, yes=older, no=none)
    yield Let(name=f"{name} now", expression=now)
    next_age = ir.DerivedValue(type=DIMENSIONLESS, name=f"{name} now")
    yield State(name=name, type=DIMENSIONLESS, initial=0.0, next=next_age)


def _true(sensor: Sensor) -> Expression:
    return ir.SensorValue(type=sensor.type, name=sensor.name)


def _error_name(sensor: Sensor) -> str:
    return f"{sensor.name} error"  # names of the language have no blanks


def _free(sensor: Sensor, what: str, default: ScalarValue) -> Sensor:
    """Return a sensor like another that is never missing."""
    return replace(sensor, name=f"{sensor.name} {what}", default=default, within_ns=None)


def _with_seen(
    program: Program, sensor: Sensor, seen: Expression, free: list[Sensor], more: list[Derived]
) -> Program:
    """Return the program in which all but contracts read `seen` in the place of a sensor."""
    let = Let(name=f"{sensor.name} seen", expression=seen)
    value = ir.DerivedValue(type=sensor.type, name=let.name)

    def change(e: Expression) -> Expression:
        if isinstance(e, ir.SensorValue) and e.name == sensor.name:
            return replace(value, span=e.span)
        return rebuilt(e, change)

    copies, truly = _true_lets(program, sensor.name)
    robot = replace(program.robot, sensors=(*program.robot.sensors, *free))
    return replace(
        program,
        robot=robot,
        derived=(*more, let, *_changed(program.derived, change), *copies),
        modules=_changed(program.modules, change),
        limits=_changed(program.limits, change),
        contracts=tuple(replace(c, expression=truly(c.expression)) for c in program.contracts),
    )


def _true_lets(program: Program, sensor: str) -> tuple[list[Let], Callable[[Expression], Expression]]:
    """Return copies of the lets that depend on a sensor, and a function by which expressions read these."""
    names = dict[str, str]()
    copies: list[Let] = []
    calls = (x.cell for x in all_subexpressions(program) if isinstance(x, ir.MemoryCall))
    cells = count(1 + MAX_READINGS + max(calls, default=0))

    def truly(e: Expression) -> Expression:
        if isinstance(e, ir.DerivedValue | ir.Fresh) and e.name in names:
            return replace(e, name=names[e.name])
        return rebuilt(e, truly)

    for let in program.derived:
        parts = ir.subexpressions(let.expression) if isinstance(let, Let) else ()
        kinds = (ir.SensorValue, ir.DerivedValue, ir.Fresh)
        if isinstance(let, Let) and any(
            isinstance(x, kinds) and (x.name == sensor or x.name in names) for x in parts
        ):
            own = with_new_cells(let.expression, lambda: next(cells))
            copies.append(replace(let, name=f"true {let.name}", expression=truly(own)))
            names[let.name] = copies[-1].name
    return copies, truly


_Node = TypeVar("_Node")


def _changed(node: _Node, change: Callable[[Expression], Expression]) -> _Node:
    """Return a part of a program with each of its expressions changed."""
    found: Any = node
    if isinstance(node, TypedNode):
        found = change(node)  # type: ignore[arg-type]
    elif type(node) is tuple:  # a span is one, too
        found = tuple(_changed(x, change) for x in found)
    elif isinstance(node, Record):
        changed = {f.name: _changed(getattr(node, f.name), change) for f in fields(node)}  # type: ignore[arg-type]
        found = replace(node, **changed)  # type: ignore[type-var]
    return cast(_Node, found)
