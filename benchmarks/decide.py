"""Deciding among N behaviors in strict priority: generated Python, hand-written Python, behavior trees.

Behavior i is applicable where `sensor[i] < 0.5`, which each is with probability 2 / N, anew in every tick;
its command is computed from two sensor values. Given a reading of N floats, each contestant finds the first
behavior that is applicable and its command. Figures are medians of batches that take turns, in nanoseconds a
tick.

The *checked* chain is what a good engineer writes by hand where a robot depends on it: the reading must be
there, a list or tuple of N floats, none of them NaN or outside the sensor's range, and the command must be
finite and within the actuator's range; the quick test of each is the same as in the generated program. The
*bare* chain trusts its input and its output. Behavior trees have one node a behavior and check nothing.
"""

from __future__ import annotations

import gc
import random
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from math import isfinite
from statistics import median
from time import perf_counter_ns
from typing import Any, NamedTuple

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.ir.expression import Binary, BinaryOperation, Constant, Element, Expression, SensorValue
from colony.ir.program import (
    Actuator,
    ActuatorField,
    Chain,
    Module,
    Program,
    Robot,
    Sensor,
    TransferFunction,
    Use,
    Wire,
)
from colony.ir.types import BOOL, DIMENSIONLESS, Array, Type

SIZES = (10, 100, 1000)
MOST_TIMES_CHECKED = 1.2
SEED = 1
ROUNDS = 41
BATCH_NS = 2_000_000
READINGS = 97

Row = dict[str, object]
Readings = dict[str, list[float]]
Tick = Callable[[int, Readings], Any]

_HIGHEST = (600.0, 90.0)


def run() -> list[Row]:
    """One row a figure: name, value, unit, target (None: only told), ok, note."""
    rows: list[Row] = []
    for size in SIZES:
        measured = measure(size)
        generated, checked = measured["generated"], measured["checked chain"]
        rows.append(_row(f"N={size}, generated / checked chain", generated / checked, MOST_TIMES_CHECKED))
        for name, ns in measured.items():
            ratio = f"{ns / generated:.3g} times the generated" if name != "generated" else ""
            rows.append(_row(f"N={size}, {name}", ns, None, "ns", ratio))
    return rows


class Contestant(NamedTuple):
    """`tick(t_ns, readings)` is what is timed; `winner` says who won, from what it gave."""

    tick: Tick
    winner: Callable[[Any], str | None]


def measure(size: int) -> dict[str, float]:
    """Median nanoseconds a tick of every contestant, after all have been seen to agree."""
    draw = random.Random(SEED)
    readings = [[draw.uniform(0.0, size / 4) for _ in range(size)] for _ in range(READINGS)]
    frames = [{"sensor": reading} for reading in readings]
    contestants = _contestants(size)
    for name, contestant in contestants.items():
        for frame in frames:
            assert contestant.winner(contestant.tick(0, frame)) == _expected(frame["sensor"]), name
    counts = {name: _batch(c.tick, frames) for name, c in contestants.items()}
    times: dict[str, list[float]] = {name: [] for name in contestants}
    ballast: list[bytes] = []
    gc.disable()
    try:
        for _ in range(ROUNDS):
            for name, contestant in contestants.items():
                _stir(ballast, draw)
                times[name].append(_timed(contestant.tick, frames, counts[name]) / counts[name])
    finally:
        gc.enable()
    return {name: median(found) for name, found in times.items()}


def _stir(ballast: list[bytes], draw: random.Random) -> None:
    """Change where the heap ends: a tick that allocates there can take twice as long, by luck alone."""
    del ballast[: draw.randrange(len(ballast) + 1)]
    ballast += [bytes(draw.randrange(1_000, 200_000)) for _ in range(draw.randrange(1, 8))]


def _batch(tick: Tick, frames: Sequence[Readings]) -> int:
    """How many ticks take about `BATCH_NS`."""
    return max(3, BATCH_NS * len(frames) // _timed(tick, frames, len(frames)))


def _timed(tick: Tick, frames: Sequence[Readings], count: int) -> int:
    """Nanoseconds for `count` ticks."""
    turns = [frames[i % len(frames)] for i in range(count)]
    start = perf_counter_ns()
    for frame in turns:
        tick(0, frame)
    return perf_counter_ns() - start


def _expected(reading: list[float]) -> str | None:
    return next((f"b{i}" for i, x in enumerate(reading) if x < 0.5), None)


# --- contestants ---------------------------------------------------------------------------------


def _contestants(size: int) -> dict[str, Contestant]:
    found = {
        "generated": Contestant(generated(size), lambda result: result[0][0][1]),
        "checked chain": Contestant(checked_chain(size), lambda result: result[0]),
        "bare chain": Contestant(bare_chain(size), lambda result: result and result[0]),
    }
    if find_spec("py_trees"):
        found["py_trees"] = Contestant(py_trees_tick(size), lambda result: result)
    if find_spec("behaviortreepy"):
        found["behaviortreepy"] = Contestant(behaviortreepy_tick(size), lambda result: result)
    return found


def generated(size: int) -> Tick:
    """`step` of the generated program."""
    program = workload(size)
    tick: Tick = load(generate(compile_program(program).compiled)).program.step
    return tick


def _command(i: int, size: int, reading: str) -> tuple[str, str]:
    """The command of behavior i, as Python: from two values, in range where it is applicable."""
    velocity = f"400.0 * {reading}[{i}] + 100.0"
    return velocity, f"60.0 * {reading}[{i}] - {200.0 / size!r} * {reading}[{(i + 1) % size}]"


def checked_chain(size: int) -> Tick:
    """A chain by hand that checks what goes in and out."""
    lines = [
        "class Chain:",
        "    def step(self, t_ns, readings):",
        "        records = []",
        "        s = readings.get('sensor')",
        "        if not (",
        "            (type(s) is list or type(s) is tuple)",
        "            and [*map(type, s)] == FLOATS",
        f"            and not [x for x in s if not (0.0 <= x and x <= {size / 4!r})]",
        "        ):",
        "            s = self.repaired(s, records)",
        "            if s is None:",
        "                return None, (0.0, 0.0), None, records",
        "        while True:",
    ]
    for i in range(size):
        velocity, turn = _command(i, size, "s")
        lines += [f"            if s[{i}] < 0.5:", f"                by = 'b{i}'"]
        lines += [f"                v = {velocity}", f"                w = {turn}", "                break"]
    lines += [
        "            return None, (0.0, 0.0), None, records",
        "        if -600.0 <= v <= 600.0 and -90.0 <= w <= 90.0:",
        "            return by, (v, w), None, records",
        "        if not (isfinite(v) and isfinite(w)):",
        "            return by, (0.0, 0.0), 'not finite', records",
        "        records.append('clamped')",
        "        v, w = min(max(v, -600.0), 600.0), min(max(w, -90.0), 90.0)",
        "        return by, (v, w), None, records",
        "    def repaired(self, s, records):",
        "        records.append('faulty')",
    ]
    names: dict[str, Any] = {"isfinite": isfinite, "FLOATS": [float] * size}
    exec("\n".join(lines), names)
    tick: Tick = names["Chain"]().step
    return tick


def bare_chain(size: int) -> Tick:
    """A chain by hand that trusts what goes in and out."""
    lines = ["def step(t_ns, readings):", "    s = readings['sensor']"]
    for i in range(size):
        velocity, turn = _command(i, size, "s")
        lines += [f"    if s[{i}] < 0.5:", f"        return 'b{i}', {velocity}, {turn}"]
    names: dict[str, Any] = {}
    exec("\n".join(lines), names)
    tick: Tick = names["step"]
    return tick


def _behavior(i: int, size: int, board: dict[str, Any]) -> Callable[[], bool]:
    """Behavior i for a tree: whether it is applicable; if so its command is on the board."""
    j, a = (i + 1) % size, 200.0 / size

    def behave() -> bool:
        s = board["sensor"]
        if s[i] < 0.5:
            board["by"] = f"b{i}"
            board["command"] = (400.0 * s[i] + 100.0, 60.0 * s[i] - a * s[j])
            return True
        return False

    return behave


def py_trees_tick(size: int) -> Tick:
    """A selector with one behavior a child."""
    import py_trees

    class Behavior(py_trees.behaviour.Behaviour):
        def __init__(self, name: str, behave: Callable[[], bool]) -> None:
            super().__init__(name)
            self.behave = behave

        def update(self) -> Any:
            status = py_trees.common.Status
            return status.SUCCESS if self.behave() else status.FAILURE

    board: dict[str, Any] = {}
    children = [Behavior(f"b{i}", _behavior(i, size, board)) for i in range(size)]
    tree = py_trees.trees.BehaviourTree(py_trees.composites.Selector("root", memory=False, children=children))
    return _ticking(board, tree.tick)


def behaviortreepy_tick(size: int) -> Tick:
    """A fallback with one action a child: BehaviorTree.CPP, the actions in Python."""
    import behaviortreepy as bt

    board: dict[str, Any] = {}
    factory = bt.BehaviorTreeFactory()

    def action(behave: Callable[[], bool]) -> Callable[[Any], Any]:
        status = bt.NodeStatus
        return lambda _: status.SUCCESS if behave() else status.FAILURE

    for i in range(size):
        factory.register_simple_action(f"B{i}", action(_behavior(i, size, board)))
    nodes = "".join(f"<B{i}/>" for i in range(size))
    tree = factory.create_tree_from_text(
        '<root BTCPP_format="4" main_tree_to_execute="T">'
        f'<BehaviorTree ID="T"><Fallback>{nodes}</Fallback></BehaviorTree></root>'
    )
    tick = _ticking(board, tree.tick_exactly_once)
    tick.keep = (factory, tree)  # type: ignore[attr-defined]
    return tick


def _ticking(board: dict[str, Any], tick: Callable[[], Any]) -> Tick:
    def ticking(t_ns: int, readings: Readings) -> Any:
        board["sensor"], board["by"] = readings["sensor"], None
        tick()
        return board["by"]

    return ticking


# --- the workload --------------------------------------------------------------------------------


def workload(size: int) -> Program:
    """The program: N modules over one sensor of N numbers, each suppressing those after it."""
    reading = SensorValue(type=Array(DIMENSIONLESS, size), name="sensor")

    def number(value: float) -> Constant:
        return Constant(type=DIMENSIONLESS, value=value)

    def element(i: int) -> Expression:
        return Element(type=DIMENSIONLESS, array=reading, index=number(float(i % size)), wraps=False)

    def of(operator: Binary, left: Expression, right: Expression, type_: Type = DIMENSIONLESS) -> Expression:
        return BinaryOperation(type=type_, operator=operator, left=left, right=right)

    def module(i: int) -> Module:
        velocity = of(Binary.ADD, of(Binary.MULTIPLY, number(400.0), element(i)), number(100.0))
        turn = of(
            Binary.SUBTRACT,
            of(Binary.MULTIPLY, number(60.0), element(i)),
            of(Binary.MULTIPLY, number(200.0 / size), element(i + 1)),
        )
        return Module(
            name=f"b{i}",
            when=of(Binary.LESS, element(i), number(0.5), BOOL),
            command=TransferFunction(actuator="drive", fields=(velocity, turn)),
        )

    sensor = Sensor(
        name="sensor",
        type=Array(DIMENSIONLESS, size),
        low=0.0,
        high=size / 4,
        server="DServer",
        field="sensor",
    )
    fields = tuple(
        ActuatorField(name=name, type=DIMENSIONLESS, low=-highest, high=highest)
        for name, highest in zip(("velocity", "turn"), _HIGHEST, strict=True)
    )
    drive = Actuator(name="drive", fields=fields, server="RServer", command="drive", idle=(0.0, 0.0))
    chain = Chain(
        relation="suppresses",
        operands=tuple(Use(name=f"b{i}") for i in range(size)),
        windows_ns=(0,) * (size - 1),
    )
    return Program(
        robot=Robot(name="bench", sensors=(sensor,), actuators=(drive,)),
        modules=tuple(module(i) for i in range(size)),
        wires=(Wire(name="drive", wiring=chain, actuator="drive"),),
    )


def _row(name: str, value: float, target: float | None, unit: str = "times", note: str = "") -> Row:
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


def main(rows: list[Row]) -> None:
    """Print a table of figures."""
    for row in rows:
        target = "" if row["target"] is None else f"{row['target']:g}"
        verdict = "" if row["target"] is None else "ok" if row["ok"] else "MISS"
        print(
            f"{row['name']:36} {row['value']:>12,.4g} {row['unit']:5} {target:>4} {verdict:4} {row['note']}"
        )


if __name__ == "__main__":
    main(run())
