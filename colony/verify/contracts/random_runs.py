"""Random runs of the reference interpreter: they find broken contracts where formulas cannot decide."""

from __future__ import annotations

from random import Random

from colony.ir.program import Program
from colony.verify.contracts.replay import Replay
from colony.verify.snapshot import Snapshot, snapshot_of
from colony.verify.symbolic.system import Disturbance
from colony.verify.testing.disturbed import disturbed_run
from colony.verify.testing.drawing import Choices
from colony.verify.testing.guided import Guide

_TRACES = 150
_FRAMES = 8


def random_counterexample(
    program: Program, replay: Replay, disturbance: Disturbance | None = None
) -> tuple[Snapshot, ...] | None:
    """Return the first of a few random runs that breaks the contract, None if none does. Deterministic.

    With a disturbance, actuators are idle and modules lost in some frames; with `OPERATORS`, connections
    command actuators in others.
    """
    guide = Guide(program, _FRAMES)
    for seed in range(replay.affordable_runs(_TRACES)):
        trace = guide.draw(Choices(Random(seed)))
        snapshots = tuple(snapshot_of(program, frame) for frame in trace)
        if disturbance is not None:
            operators = disturbance is Disturbance.OPERATORS
            disturbed = disturbed_run(Choices(Random(seed)), replay.program, trace, operators=operators)
            snapshots = tuple(
                snapshot._replace(given=frame.given, lost=frame.lost)
                for snapshot, frame in zip(snapshots, disturbed, strict=True)
            )
        outcomes, breach = replay.outcomes_and_breach(snapshots)
        if breach is not None:
            return snapshots
        guide.learn(trace, [tuple((d.by, d.fault) for d in o.decisions) for o in outcomes])
    return None
