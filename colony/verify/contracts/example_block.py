"""A run as a `test` block: it fails until the contract holds in it, or expects at its end what it reaches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from colony.dsl import ast
from colony.dsl.printer import print_file
from colony.ir.bearings import naming_angle
from colony.ir.program import ActuatorField, Contract, Program, Sensor
from colony.ir.types import Enum, ScalarValue, Value, bearings_of, element_type
from colony.verify.contracts.results import Trace, expectation
from colony.verify.contracts.table import NumberText, number_text, seconds
from colony.verify.snapshot import ElementRun, Snapshot, differing, run_angles, sparse


def title(contract: Contract) -> str:
    """Return the title of the test for a contract, or for a reach."""
    return f"{'reach' if contract.reach else 'counterexample'}: {contract.name}"


def example_block(program: Program, contract: Contract, trace: Trace, name: str | None = None) -> str | None:
    """Return the text of a test with the frames of `trace`.

    None if the language cannot write one of its values or what it reaches, or if the trace needs answers of
    Python modules.
    """
    expected = expectation(program, contract) if contract.reach else None
    if contract.reach and expected is None:
        return None
    at_end = () if expected is None else (expected,)
    expectations = [()] * (len(trace.snapshots) - 1) + [at_end]
    return test_block(program, name or title(contract), trace.snapshots, expectations)


def test_block(
    program: Program,
    name: str,
    snapshots: Sequence[Snapshot],
    expectations: Sequence[tuple[ast.Expression, ...]],
) -> str | None:
    """Return the text of a test with these frames, and what is expected in each.

    None if the language cannot write a value, or if the frames need answers of Python modules.
    """
    if any(s.answers for s in snapshots):
        return None
    sensors = {s.name: s for s in program.robot.sensors}
    frames = list[_Frame]()
    before: dict[str, Value | None] = {}
    for snapshot, expected in zip(snapshots, expectations, strict=True):
        given = [g for s in sensors.values() for g in _given(s, before, snapshot.readings)]
        if snapshot.restarted:
            is_true = ast.Boolean(value=True)
            given.insert(
                0, ast.GivenDecl(sensor=ast.Reference(path=("restarted",)), index=None, value=is_true)
            )
        if None in given:
            return None
        frames.append(_Frame(snapshot.t_ns, tuple(g for g in given if g is not None), expected))
        before = dict(snapshot.readings)
    test = ast.TestDecl(title=name, steps=tuple(_steps(frames)))
    return print_file(ast.File(declarations=(test,)))


class _Frame(NamedTuple):
    """The time of a frame, what it gives, and what is expected in it."""

    t_ns: int
    given: tuple[ast.GivenDecl, ...]
    expect: tuple[ast.Expression, ...]


def _steps(frames: Sequence[_Frame]) -> Iterator[ast.StepDecl]:
    """Yield the steps; frames at equal distances with nothing new given or expected are one `from ... to`."""
    i = 0
    while i < len(frames):
        first, last = frames[i], i
        while (
            last + 1 < len(frames)
            and not frames[last + 1].given
            and frames[last + 1].expect == first.expect
            and _at_equal_distances(frames, i, last + 1)
        ):
            last += 1
        if last < i + 2:
            last = i
        period_ns = frames[i + 1].t_ns - first.t_ns if last > i else None
        yield ast.StepDecl(
            first=_number(seconds(first.t_ns)),
            last=None if last == i else _number(seconds(frames[last].t_ns)),
            period=None if period_ns is None else _number(seconds(period_ns)),
            given=first.given,
            expect=first.expect,
        )
        i = last + 1


def _at_equal_distances(frames: Sequence[_Frame], first: int, last: int) -> bool:
    return frames[last].t_ns - frames[last - 1].t_ns == frames[first + 1].t_ns - frames[first].t_ns


def _given(
    sensor: Sensor, last: Mapping[str, Value | None], readings: Mapping[str, Value | None]
) -> Iterator[ast.GivenDecl | None]:
    """Yield the assignments that change a sensor from `last`; None for a value that cannot be written.

    What an actuator was given cannot be taken back once a test gives it.
    """
    value, before = readings.get(sensor.name), last.get(sensor.name)
    if sensor.sent is not None and (sensor.name in last) is not (sensor.name in readings):
        yield None if sensor.name in last else _of_value(sensor, value)
        return
    if value == before:
        return
    if value is None:
        yield _assignment(sensor, None, ast.Missing())
        return
    if not isinstance(value, tuple):
        yield _scalar_assignment(sensor, None, value)
        return
    if isinstance(before, tuple):
        changed = differing(value, before, bearings_of(sensor.type))
        if changed is not None:
            yield from (_scalar_assignment(sensor, run, run.value) for run in changed)
            return
    yield from _array_assignments(sensor, value)


def _of_value(sensor: Sensor, value: Value | None) -> ast.GivenDecl | None:
    """Return the assignment of a scalar; None for a value that cannot be written."""
    assert not isinstance(value, tuple), "fields of actuators are scalars"
    if value is None:
        return _assignment(sensor, None, ast.Missing())
    return _scalar_assignment(sensor, None, value)


def _array_assignments(sensor: Sensor, value: tuple[ScalarValue, ...]) -> Iterator[ast.GivenDecl | None]:
    """Yield the commonest value for all elements and the few runs that differ, or every element."""
    found = sparse(value, bearings_of(sensor.type))
    if found is not None:
        yield _scalar_assignment(sensor, None, found.common)
        yield from (_scalar_assignment(sensor, run, run.value) for run in found.differing)
        return
    elements = [literal(sensor, x) for x in value]
    expressible = tuple(e for e in elements if e is not None)
    yield (
        _assignment(sensor, None, ast.Elements(values=expressible))
        if len(expressible) == len(value)
        else None
    )


def _scalar_assignment(sensor: Sensor, run: ElementRun | None, value: ScalarValue) -> ast.GivenDecl | None:
    expression = literal(sensor, value)
    return None if expression is None else _assignment(sensor, run, expression)


def _assignment(
    sensor: Sensor, run: ElementRun | None, value: ast.Expression | ast.Missing | ast.Elements
) -> ast.GivenDecl:
    first, last = (None, None) if run is None else _place(sensor, run)
    reference = ast.Reference(path=tuple(sensor.name.split(".")))
    return ast.GivenDecl(sensor=reference, index=first, last=last, value=value)


def _place(sensor: Sensor, run: ElementRun) -> tuple[ast.Expression, ast.Expression | None]:
    """Return the index of one element, or the ends of a slice, as angles where these name the elements."""
    bearings = bearings_of(sensor.type)
    if run.first == run.last:
        angle = naming_angle(bearings, run.first)
        return _count(run.first) if angle is None else _degrees(angle), None
    angles = run_angles(bearings, run)
    if angles is None:
        return _count(run.first), _count(run.last)
    return _degrees(angles[0]), _degrees(angles[1])


def _count(number: int) -> ast.Expression:
    return ast.NumberNode(digits=str(number), unit=None)


def _degrees(angle: str) -> ast.Expression:
    number = ast.NumberNode(digits=angle.removeprefix("-"), unit="deg")
    return ast.Prefix(operator="-", operand=number) if angle.startswith("-") else number


def literal(sensor: Sensor | ActuatorField, value: ScalarValue) -> ast.Expression | None:
    """Return a value of a sensor or field, in base units, as a test writes it; None if it cannot."""
    type_ = element_type(sensor.type)
    if isinstance(value, bool):
        return ast.Boolean(value=value)
    if isinstance(type_, Enum):
        member = next(name for name, n in type_.members if n == value)
        return ast.Reference(path=(*type_.name.split("."), member))
    written = number_text(value, sensor)
    return None if written is None else _number(written)


def _number(written: NumberText) -> ast.Expression:
    number = ast.NumberNode(digits=written.digits, unit=written.unit)
    return ast.Prefix(operator="-", operand=number) if written.negative else number
