"""A last try before a contract is called unknown: runs that are drawn, in the reference interpreter."""

from __future__ import annotations

from random import Random

from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.ir.types import Value
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.results import Snapshot
from colony.verify.reference.boundary import sense
from colony.verify.testing.drawing import Choices
from colony.verify.testing.guided import Guide

_TRACES = 150
_FRAMES = 8


def drawn(program: Program, replay: Replay) -> tuple[Snapshot, ...] | None:
    """A run that breaks the contract, if one of a few drawn ones does. The same for the same program."""
    guide = Guide(program, _FRAMES)
    for number in range(replay.affordable(_TRACES)):
        trace = guide.draw(Choices(Random(number)))
        snapshots = tuple(_snapshot(program, frame) for frame in trace)
        if replay.breaks(snapshots):
            return snapshots
        outcomes = replay.run(snapshots)
        guide.learn(trace, [tuple((d.by, d.fault) for d in o.decisions) for o in outcomes])
    return None


def _snapshot(program: Program, frame: Frame) -> Snapshot:
    """A frame in base units; what is out of its range is as the interpreter takes it."""
    readings: dict[str, Value] = {}
    for sensor in program.robot.sensors:
        value, _ = sense(sensor, frame.readings.get(sensor.name), sensor.factor)
        if value is not None:
            readings[sensor.name] = value
    return Snapshot(t_ns=frame.t_ns, readings=readings)
