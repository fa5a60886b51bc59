"""What is noted of a run while it is driven."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import pytest

from colony.dsl.load import load_text
from colony.nav.plan.plan import FloorPoint, Plan, Segment
from colony.nav.shared import CEILING_LIGHT, GoalKind
from colony.runs.behavior import behavior_from
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import data
from colony.sim.hazards.scenery import ExpansionJoint, Scenery, WheelSlip, bare_scenery
from colony.sim.world.world import World
from studies.record import Contacts, LightCount
from studies.run_monitor import RunMonitor, mode_of
from tests.experiment.conformance_stage import PROGRAM
from tests.experiment.loops import loop_of
from tests.sim.robots import IDEAL


def _segment(kind: GoalKind, start: float, end: float, *lights: float) -> Segment:
    return Segment(
        kind=kind,
        heading_deg=270.0,
        start=FloorPoint(start, 0.0, "floor"),
        end=FloorPoint(end, 0.0, "floor"),
        width_mm=4000.0,
        lights_mm=lights,
    )


PLAN = Plan(
    origin="a",
    goal="b",
    segments=(
        _segment(GoalKind.LIGHTS, 0.0, 8000.0, 3000.0, 8000.0),
        _segment(GoalKind.ENTER_CORNER, 8000.0, 9000.0),
        _segment(GoalKind.CORNER, 9000.0, 10_000.0),
        _segment(GoalKind.DEAD_RECKONING, 10_000.0, 12_000.0),
    ),
    distance_mm=12_000.0,
    modes="lcd",
)

Step = tuple[float, Literal["segment", "light"], int]
"""After so many seconds this segment begins, or so many lights have been counted."""


class Stage:
    """A robot that drives east at half a meter a second, and a watcher of it. Mutable."""

    def __init__(
        self, *steps: Step, scenery: Scenery | None = None, wall_mm: float = 50_000.0, east_mm: float = 0.0
    ) -> None:
        begun: list[int] = []
        walls = [(wall_mm, -2e3, wall_mm, 2e3), (-5e3, 2e3, -5e3, -2e3)]
        world = self.world = World(walls=scenery or walls, poses=[(east_mm, 0.0, 270.0)], config=IDEAL)
        self.loop = loop_of(
            behavior_from(load_text(PROGRAM)),
            world,
            {"leader": _leader(steps, begun)},
            variables={"Wanted": 500.0},
        )
        self.monitor = RunMonitor(PLAN, self.loop, world, 100.0, begun)

    def drive(self, until: Callable[[], bool], most: int = 8000) -> str:
        for _ in range(most):
            self.loop.frame()
            failure = self.monitor.update()
            if failure or until():
                return failure
        raise AssertionError("it did not come so far")


def _leader(steps: Sequence[Step], begun: list[int]) -> Script:
    """Begin segments and count lights, each so many seconds after the step before."""
    for seconds, what, number in steps:
        yield from sleep(seconds)
        if what == "segment":
            begun.append(number)
            yield from do("DServer", data.set(CEILING_LIGHT, 0))
        else:
            yield from do("DServer", data.set(CEILING_LIGHT, number))


def test_modes_are_counted_as_they_are_entered_and_completed() -> None:
    stage = Stage(*((1.0, "segment", number) for number in range(4)))
    found = []
    for t_s in (0.5, 1.5, 2.5, 3.5, 4.5):
        stage.drive(lambda t_s=t_s: stage.loop.now_ns >= t_s * 1e9)  # type: ignore[misc]
        found.append(_modes(stage.monitor))
    stage.monitor.done = True
    found.append(_modes(stage.monitor))
    assert found == [
        ((0, 0, 0), (0, 0, 0), 0, "L"),
        ((1, 0, 0), (0, 0, 0), 0, "L"),
        ((1, 1, 0), (1, 0, 0), 1, "C"),
        ((1, 1, 0), (1, 0, 0), 1, "C"),
        ((1, 1, 1), (1, 1, 0), 2, "D"),
        ((1, 1, 1), (1, 1, 1), 3, "D"),
    ]
    assert [mode.needed for mode in stage.monitor.mode_counts()] == [1, 1, 1]


def _modes(monitor: RunMonitor) -> tuple[object, ...]:
    modes = monitor.mode_counts()
    entered, completed = (tuple(getattr(mode, name) for mode in modes) for name in ("entered", "completed"))
    return entered, completed, monitor.completed, monitor.mode


def _lights(*steps: Step, until_s: float, east_mm: float = 0.0) -> RunMonitor:
    stage = Stage((0.05, "segment", 0), *steps, east_mm=east_mm)
    stage.drive(lambda: stage.loop.now_ns >= until_s * 1e9)
    return stage.monitor


def test_lights_are_seen_missed_or_false_by_where_the_robot_is() -> None:
    # At half a meter a second the lights hang 6 and 16 seconds away.
    right = _lights((6.3, "light", 1), (10.3, "light", 2), until_s=19.0)
    assert right.lights == LightCount(2, 0, 0)
    assert right.first_light
    early = _lights((1.0, "light", 1), until_s=2.0)
    assert early.lights == LightCount(0, 0, 1)
    passed = _lights((1.0, "light", 1), until_s=13.0)
    assert passed.lights == LightCount(0, 1, 1)  # the second is still ahead
    assert not passed.first_light
    twice = _lights((6.0, "light", 1), (0.5, "light", 2), until_s=8.0)
    assert twice.lights == LightCount(1, 0, 1)
    left = _lights((6.0, "light", 1), (1.0, "segment", 1), until_s=8.0)
    assert left.lights == LightCount(1, 1, 0)


def test_lights_behind_the_robot_when_the_leg_begins_are_not_missed() -> None:
    begun_late = _lights((8.6, "light", 1), until_s=13.0, east_mm=4000.0)
    assert begun_late.lights == LightCount(1, 0, 0)


def test_a_wall_is_a_contact_and_then_the_robot_is_stuck() -> None:
    stage = Stage(wall_mm=3000.0)
    assert stage.drive(lambda: False) == "stuck"
    contacts = stage.monitor.contacts
    assert contacts.number >= 1
    assert contacts.fastest_mm_s == pytest.approx(500.0, abs=20.0)
    assert stage.monitor.top_mm_s == pytest.approx(500.0, abs=1.0)
    assert Stage().monitor.contacts == Contacts(0, 0.0)
    assert 60e9 <= stage.loop.now_ns <= 70e9


def test_new_goals_are_progress_for_a_robot_that_stands() -> None:
    stage = Stage(*((30.0, "segment", number) for number in (0, 1, 2)), wall_mm=1000.0)
    assert stage.drive(lambda: False) == "stuck"
    assert stage.loop.now_ns >= 150e9


def test_patience_ends_after_three_times_what_was_expected() -> None:
    stage = Stage(wall_mm=1e6)
    assert stage.drive(lambda: False) == "too long"
    assert stage.loop.now_ns == pytest.approx(300e9, abs=1e8)


def test_slips_are_noticed_where_wheels_count_what_is_not_driven() -> None:
    slip = WheelSlip(probability=1.0, turn_deg=0.0, min_mm=30.0, max_mm=80.0)
    plain = bare_scenery(np.array([[50e3, -2e3, 50e3, 2e3]]))
    joints = tuple(ExpansionJoint(x0_mm=x, y0_mm=-2e3, x1_mm=x, y1_mm=2e3) for x in (2e3, 4e3, 7e3))
    scenery = Scenery(seed=1, walls=plain.walls, silent=plain.silent, joints=joints, slip=slip)
    stage = Stage(scenery=scenery)
    stage.drive(lambda: stage.world.true_pose(0).x_mm > 8000.0)
    assert stage.monitor.slips == 3


def test_every_kind_of_goal_has_a_mode() -> None:
    assert "".join(mode_of(kind) for kind in sorted(GoalKind)) == "DCDCLD"
