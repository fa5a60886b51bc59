"""Frames for the behaviors as they stood in version 1; `version1/NAME.decisions` has what it decided.

The decisions are the output of version 1's own `colony trace`, without broken contracts. They cannot be made
again by this version, and need not be: version 1 does not change.
"""

from __future__ import annotations

import json
import random
from pathlib import Path

from colony.ir.program import Program, Sensor
from colony.ir.types import Array, Bool, Enum, Scalar

FOLDER = Path(__file__).parent / "version1"
COUNT = 120
WITH_MISSING_SENSORS = {"wander", "allen"}
"""Behaviors that decide the same where sensors are missing: nothing in them is for a person to decide."""


def frames(program: Program, name: str) -> list[str]:
    """Lines of input for `colony trace`: readings that change now and then."""
    chance = random.Random(f"{name} 1")
    readings: dict[str, object] = {}
    lines = []
    for number in range(COUNT):
        for sensor in program.robot.sensors:
            if number == 0 or chance.random() < 0.1:
                missing = name in WITH_MISSING_SENSORS and chance.random() < 0.02
                readings[sensor.name] = None if missing else _reading(sensor, chance)
        lines.append(json.dumps({"t": number * 0.2, **readings}))
    return lines


def _reading(sensor: Sensor, chance: random.Random) -> object:
    if isinstance(sensor.type, Array):
        element = sensor.type.element
        return [_scalar(sensor, element, chance) for _ in range(sensor.type.size)]
    return _scalar(sensor, sensor.type, chance)


def _scalar(sensor: Sensor, of: Scalar, chance: random.Random) -> float | bool:
    if isinstance(of, Bool):
        return chance.random() < (0.02 if isinstance(sensor.type, Array) else 0.15)
    if isinstance(of, Enum):
        return chance.choice(of.members)[1]
    if sensor.low is None or sensor.high is None:
        return round(chance.uniform(-90, 90), 1) if sensor.unit else chance.choice((0, 0, 0, 1))
    low, high = sensor.low / sensor.factor, sensor.high / sensor.factor
    return round(chance.uniform(low, high if chance.random() < 0.9 else low + (high - low) / 8), 1)
