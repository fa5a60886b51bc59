"""Drawn programs with tunable params: number sensors of a drawn program that become params."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from colony.ir.program import TUNABLE_SERVER, Program, Sensor
from colony.ir.types import Quantity


def with_tunables(program: Program, random: Random) -> Program:
    """Return a drawn program with some of its number sensors as tunable params."""
    sensors = tuple(
        _tunable(s, random) if s.of_robot and isinstance(s.type, Quantity) and random.random() < 0.6 else s
        for s in program.robot.sensors
    )
    return replace(program, robot=replace(program.robot, sensors=sensors))


def _tunable(sensor: Sensor, random: Random) -> Sensor:
    low = -100.0 if sensor.low is None else sensor.low
    high = max(low, 100.0 if sensor.high is None else sensor.high)
    return replace(
        sensor,
        low=low,
        high=high,
        default=_between(low, high, random),
        server=TUNABLE_SERVER,
        field=sensor.name,
        within_ns=None,
        tunable=True,
    )


def draw_values(program: Program, random: Random) -> dict[str, float | None]:
    """Return new values, in declared units, of some tunable params; None for the value at the start."""
    tunables = [s for s in program.robot.sensors if s.tunable]
    chosen = random.sample(tunables, random.randint(1, len(tunables))) if tunables else []
    return {s.name: None if random.random() < 0.1 else _value(s, random) for s in chosen}


def _value(sensor: Sensor, random: Random) -> float:
    assert sensor.low is not None
    assert sensor.high is not None
    return _between(sensor.low / sensor.factor, sensor.high / sensor.factor, random)


def _between(low: float, high: float, random: Random) -> float:
    return random.choice((low, high, random.uniform(low, high)))
