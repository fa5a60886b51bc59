"""Counterexamples as frames that `colony trace --input` accepts: plain values in declared units."""

from __future__ import annotations

import math
from collections.abc import Iterable

from colony.ir.frame import Outcome
from colony.ir.program import Program, Sensor
from colony.ir.types import ScalarValue, Value
from colony.verify.snapshot import Snapshot


def frame_row(sensors: Iterable[Sensor], snapshot: Snapshot) -> dict[str, object]:
    """Return a frame: `{"t": 0.05, "bumper": true, "sonar": [3.0, ...]}`; missing values are null.

    Args:
        sensors: Sensors of the program, or programs, that the snapshot is for.
        snapshot: Time, and readings in base units.
    """
    by_name = {sensor.name: sensor for sensor in sensors}
    readings = {name: _plain(by_name[name], value) for name, value in snapshot.readings.items()}
    restarted = {"restarted": True} if snapshot.restarted else {}
    return {"t": snapshot.t_ns / 1e9, **restarted, **readings}


def outcome_row(program: Program, outcome: Outcome) -> dict[str, object]:
    """Return each actuator's winner and command: `{"drive": {"by": "avoid", "velocity": 0.15}}`."""
    fields = {a.name: [f.name for f in a.fields] for a in program.robot.actuators}
    return {
        d.actuator: {"by": d.by, **dict(zip(fields[d.actuator], d.values or (), strict=False))}
        for d in outcome.decisions
    }


def _plain(sensor: Sensor, value: Value | None) -> object:
    if isinstance(value, tuple):
        return [_declared(sensor, element) for element in value]
    return None if value is None else _declared(sensor, value)


def _declared(sensor: Sensor, value: ScalarValue) -> ScalarValue:
    """Return the value in the declared unit that converts back to exactly `value`."""
    if isinstance(value, bool):
        return value
    quotient = value / sensor.factor
    candidates = (quotient, math.nextafter(quotient, math.inf), math.nextafter(quotient, -math.inf))
    return next((x for x in candidates if x * sensor.factor == value), quotient)
