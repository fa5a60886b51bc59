"""Frames drawn at random, with values at the edges of what a program compares with."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

from colony.ir import expression as ir
from colony.ir.program import Let, Machine, Module, Program, Sensor, State
from colony.ir.types import Array, Bool, Enum, Quantity, ScalarValue, Value, element_type
from colony.verify.contracts.results import Snapshot
from colony.verify.difference.content import nodes

_FAR = 10_000.0


def frames(program: Program, random: Random, count: int) -> Iterator[Snapshot]:
    """`count` frames of one run: sensors mostly there and as they were, frames mostly a period apart."""
    said = list(dict.fromkeys(_constants(program)))
    durations = [d for d in dict.fromkeys(_durations(program)) if d > 0] or [program.robot.frame_ns]
    now: dict[str, Value] = {}
    t_ns = 0
    for i in range(count):
        for sensor in program.robot.sensors:
            if i == 0 or random.random() < 0.3:
                now[sensor.name] = _value(sensor, random, said, now.get(sensor.name))
        gone = {s.name for s in program.robot.sensors if random.random() < 0.04}
        yield Snapshot(t_ns=t_ns, readings={n: v for n, v in now.items() if n not in gone})
        t_ns += random.choice(durations) if random.random() < 0.2 else program.robot.frame_ns


def _value(sensor: Sensor, random: Random, said: list[float], before: Value | None) -> Value:
    of = sensor.type
    if not isinstance(of, Array):
        return _scalar(sensor, random, said)
    values = list(before) if isinstance(before, tuple) and random.random() < 0.6 else []
    if not values:
        values = [_scalar(sensor, random, said)] * of.size
    for _ in range(random.choice((0, 1, 2, of.size))):
        values[random.randrange(of.size)] = _scalar(sensor, random, said)
    return tuple(values)


def _scalar(sensor: Sensor, random: Random, said: list[float]) -> ScalarValue:
    match element_type(sensor.type):
        case Bool():
            return random.random() < 0.5
        case Enum(members=members):
            return random.choice(members)[1]
        case Quantity():
            low = -_FAR if sensor.low is None else sensor.low
            high = _FAR if sensor.high is None else sensor.high
            edge = random.choice(said) * random.choice((0.5, 0.999, 1.0, 1.001, -1.0)) if said else 0.0
            drawn = random.choice((random.uniform(low, high), edge, edge, low, high))
            return min(max(drawn, low), high)


def expressions(program: Program) -> Iterator[ir.Expression]:
    for derived in program.derived:
        match derived:
            case Let(expression=e):
                yield e
            case State(next=following):
                yield from () if following is None else (following,)
            case Machine(transitions=transitions):
                yield from (t.condition for t in transitions)
    for module in program.modules:
        if isinstance(module, Module):
            yield module.when
            yield from module.command.fields if module.command else ()
            yield from (let.expression for let in module.lets)
            yield from (s.next for s in module.states if s.next is not None)


def _constants(program: Program) -> Iterator[float]:
    for expression in expressions(program):
        for node in nodes(expression):
            if isinstance(node, ir.Constant) and isinstance(node.value, float | int):
                yield float(node.value)


def _durations(program: Program) -> Iterator[int]:
    for expression in expressions(program):
        for node in nodes(expression):
            if isinstance(node, ir.MemoryCall) and node.duration_ns:
                yield node.duration_ns
    for wire in program.wires:
        if not hasattr(wire.wiring, "name"):
            yield from (w for w in wire.wiring.windows_ns)
