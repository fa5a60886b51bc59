"""Random runs of the reference interpreter: they find broken contracts where formulas cannot decide."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from colony.ir.frame import Given
from colony.ir.program import Program, modules_that_can_be_lost
from colony.verify.contracts.replay import Replay
from colony.verify.snapshot import Snapshot, snapshot_of
from colony.verify.testing.drawing import Choices
from colony.verify.testing.guided import Guide

_TRACES = 150
_FRAMES = 8
_LATE_PROBABILITY = 0.3


def random_counterexample(
    program: Program, replay: Replay, late: bool = False
) -> tuple[Snapshot, ...] | None:
    """Return the first of a few random runs that breaks the contract, None if none does. Deterministic.

    With `late`, actuators are idle and modules lost in some frames.
    """
    guide = Guide(program, _FRAMES)
    for seed in range(replay.affordable_runs(_TRACES)):
        trace = guide.draw(Choices(Random(seed)))
        snapshots = tuple(snapshot_of(program, frame) for frame in trace)
        if late:
            snapshots = with_late_clients(program, snapshots, Random(seed))
        if replay.breaks(snapshots):
            return snapshots
        outcomes = replay.run(snapshots)
        guide.learn(trace, [tuple((d.by, d.fault) for d in o.decisions) for o in outcomes])
    return None


def with_late_clients(
    program: Program, snapshots: Sequence[Snapshot], random: Random
) -> tuple[Snapshot, ...]:
    """Return a run in which some actuators are idle, and some clients lost, in some frames."""
    actuators = [a.name for a in program.robot.actuators]
    can_be_lost = modules_that_can_be_lost(program)
    return tuple(
        snapshot._replace(
            given={a: Given() for a in actuators if random.random() < _LATE_PROBABILITY},
            lost=frozenset(m for m in can_be_lost if random.random() < _LATE_PROBABILITY),
        )
        for snapshot in snapshots
    )
