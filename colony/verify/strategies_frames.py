"""Frames for a program: sensor readings near what it compares with, and times near what it waits for."""

from __future__ import annotations

import math
from collections.abc import Iterator

from colony.ir import expression as ir
from colony.ir.frame import Frame, Reading
from colony.ir.program import Chain, Let, Machine, Module, Program, PythonModule, Sensor, State, Wiring
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, ScalarValue
from colony.verify.strategies_drawing import Choices

ODD_READINGS: tuple[Reading, ...] = (
    None,
    math.nan,
    math.inf,
    -math.inf,
    True,
    1e300,
    10**400,
    "high",  # type: ignore[assignment]  # a faulty server sends anything
    (),
    (1.0, math.nan),
    3,
)
"""Readings that are wrong for most sensors, each in its way."""


def draw_frame(choices: Choices, program: Program, t_ns: int) -> Frame:
    """See `colony.verify.strategies.frames`."""
    numbers = constants_of(program)
    return Frame(t_ns, {s.name: _reading(choices, s, numbers) for s in program.robot.sensors})


def draw_trace(choices: Choices, program: Program, max_frames: int) -> tuple[Frame, ...]:
    """See `colony.verify.strategies.traces`."""
    numbers = constants_of(program)
    # A few readings a sensor, met again and again: memory shows only where values come back.
    pools = {
        s.name: [_reading(choices, s, numbers) for _ in range(choices.several(1, 4))]
        for s in program.robot.sensors
    }
    gaps = _gaps(program)
    t_ns = choices.one((0, 1_000_000_000, 1, -50_000_001))
    frames: list[Frame] = []
    while not frames or (len(frames) < max_frames and choices.upto(14) > 0):
        frames.append(Frame(t_ns, {name: choices.one(pool) for name, pool in pools.items()}))
        t_ns += choices.one(gaps)
    return tuple(frames)


# --- readings ------------------------------------------------------------------------------------


def _reading(choices: Choices, sensor: Sensor, numbers: list[float]) -> Reading:
    if choices.rarely(15):
        return choices.one(ODD_READINGS)
    if not isinstance(sensor.type, Array):
        return _scalar(choices, sensor.type, sensor, numbers)
    element, size = sensor.type.element, sensor.type.size
    if choices.rarely(25):
        size += choices.one((1, -1))
    elements = [_scalar(choices, element, sensor, numbers) for _ in range(size)]
    return tuple(elements) if choices.rarely(2) else elements


def _scalar(choices: Choices, of: Scalar, sensor: Sensor, numbers: list[float]) -> ScalarValue | int:
    match of:
        case Bool():
            return choices.upto(1) == 1
        case Enum(members=members):
            value = choices.one(members)[1]
            return int(value) if value.is_integer() and choices.rarely(3) else value
        case Quantity():
            bounds = [x / sensor.factor for x in (sensor.low, sensor.high) if x is not None]
            near = [x / sensor.factor for x in numbers]
            return choices.one((0.0, 1.0, *bounds, *near, 2, -1, -0.0, 2.5, 100.0, 0.5, -7.25, 1e12, -0.0))


def constants_of(program: Program) -> list[float]:
    """The finite numbers that the program's expressions name, in base units, the first few."""
    found: dict[float, None] = {}
    for root in expressions_of(program):
        for node in _walk(root):
            if isinstance(node, ir.Constant) and isinstance(node.value, float) and math.isfinite(node.value):
                found[node.value] = None
    return list(found)[:12]


# --- times ---------------------------------------------------------------------------------------


def _gaps(program: Program) -> list[int]:
    """Times between frames: a frame, a few, and whatever the program waits for, to the nanosecond."""
    frame = program.robot.frame_ns
    gaps = {frame: None, 2 * frame: None, 3 * frame: None, 1: None}
    for duration in durations_of(program):
        for gap in (duration, duration - 1, duration + 1, duration - frame):
            if gap > 0:
                gaps[gap] = None
    return list(gaps)


def durations_of(program: Program) -> list[int]:
    """The durations that the program measures, in nanoseconds, each once."""
    found: dict[int, None] = {}
    for wire in program.wires:
        for window_ns in _windows(wire.wiring):
            found[window_ns] = None
    for root in expressions_of(program):
        for node in _walk(root):
            if isinstance(node, ir.MemoryCall):
                found[node.duration_ns] = None
    for module in program.modules:
        if isinstance(module, PythonModule) and module.rate_ns is not None:
            found[module.rate_ns] = None
    found.pop(0, None)
    return list(found)


def _windows(wiring: Wiring) -> Iterator[int]:
    if isinstance(wiring, Chain):
        yield from wiring.windows_ns
        for operand in wiring.operands:
            yield from _windows(operand)


# --- the program's expressions -------------------------------------------------------------------


def expressions_of(program: Program) -> Iterator[ir.Expression]:
    """All expressions of a program that are evaluated every frame."""
    for derived in program.derived:
        match derived:
            case Let(expression=expression):
                yield expression
            case State(next=following) if following is not None:
                yield following
            case Machine(transitions=transitions):
                yield from (t.condition for t in transitions)
            case _:
                pass
    for module in program.modules:
        if isinstance(module, Module):
            yield from (let.expression for let in module.lets)
            yield module.when
            yield from module.command.fields if module.command else ()
            yield from (s.next for s in module.states if s.next is not None)
    for limit in program.limits:
        yield limit.bound
        if limit.condition is not None:
            yield limit.condition
    yield from (contract.expression for contract in program.contracts)


def _walk(root: ir.Expression) -> Iterator[ir.Expression]:
    yield root
    for child in ir.children(root):
        yield from _walk(child)
