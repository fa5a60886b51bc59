""""""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.walls import Walls
from colony.nav.pose.estimate import pose_estimator
from colony.nav.pose.pose import fix_of
from colony.nav.pose.tracker import PoseSource
from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    GOAL_DIRECTION,
    GOAL_DISTANCE,
    GOAL_TYPE,
    LIGHT_DETECTED,
    LIGHT_FIX,
    LIGHT_OFFSET,
    OVERSHOOT,
    TRACK_DATA,
    TRACK_START,
    GoalKind,
)
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.script import Script, ScriptError, do, sleep
from colony.runtime.library import data, robot
from colony.runtime.library.robot import Position
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.drivers import image_of
from colony.sim.hazards.scenery import CeilingLight, bare_scenery
from colony.sim.world.world import World
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.tracker import light_tracker, position_at
from tests.among_servers import run_among_servers
from tests.sampling import sampled
from tests.vision.lights.corridors import Ceiling, Robot, Stage

PLACES = tuple(2500.0 + 5500.0 * i for i in range(5))
UNFINISHED: dict[str, object] = {
    GOAL_TYPE: int(GoalKind.LIGHTS),
    GOAL_DISTANCE: len(PLACES),
    GOAL_DIRECTION: 0.0,
    LIGHT_OFFSET: [PLACES[0], *[5500.0] * 4],
    CEILING_LIGHT: 0,
    TRACK_START: [0.0, 0.0],
}
"""What a tracker finds that begins where one before it was ended."""


NO_WALLS = Walls(segments=np.empty((0, 4)), kinds=(), attributes=())


def ceiling(*out: int, level: float = 240.0) -> Ceiling:
    return Ceiling(lights=tuple((place, level) for i, place in enumerate(PLACES) if i not in out))


def driven(
    ceiling: Ceiling,
    robot: Robot,
    *,
    seed: int = 1,
    goals: Sequence[Sequence[float]] = (PLACES,),
    seconds: float = 120.0,
    patience_s: float | None = None,
    alone: bool = False,
    **kinds: Any,
) -> Stage:
    """The tracker, and unless it is alone the estimator of the pose, which knows of lights only."""
    print(f"seed {seed}")
    scripts = {"tracker": light_tracker(**kinds)}
    if not alone:
        scripts["estimator"] = pose_estimator({"": NO_WALLS}, sources=frozenset({PoseSource.LIGHTS}))
    stage = Stage(ceiling, robot, scripts, seed=seed, goals=goals, patience_s=patience_s)
    stage.run(seconds)
    return stage


def numbers(stage: Stage) -> list[int]:
    return [number for _, number in stage.log.counts]


def test_it_counts_every_light_when_the_robot_is_below_it() -> None:
    stage = driven(ceiling(), Robot())
    assert numbers(stage) == [0, 1, 2, 3, 4, 5]
    for (at, _), place in zip(stage.log.counts[1:], PLACES, strict=True):
        assert place - 15.0 <= at <= place + 30.0
    assert stage.semaphore(LIGHT_DETECTED) == 5


def test_the_overshoot_is_how_far_the_robot_is_beyond_the_last_light() -> None:
    for speed in (120.0, 300.0, 500.0):
        stage = driven(ceiling(), Robot(speed=speed), seconds=240.0)
        ((at, overshoot),) = stage.log.overshoots
        assert overshoot == pytest.approx(at - PLACES[-1], abs=10.0)
        assert 0.0 <= overshoot <= 40.0


@pytest.mark.parametrize(
    "robot",
    sampled(
        [
            Robot(off_mm=300.0),
            Robot(off_mm=-300.0),
            Robot(scale=1.02),
            Robot(scale=0.98, speed=500.0),
            Robot(slips=((4000.0, 80.0), (12_000.0, 50.0))),
            Robot(tilt_deg=5.0),
            Robot(left_mm=500.0),
            Robot(silent=(2000.0, 4000.0)),
            Robot(stands=((2200.0, 3.0), (2700.0, 10.0))),
        ],
        every=4,
    ),
    ids=["ahead", "behind", "long", "short", "slips", "tilted", "aside", "silent", "stands"],
)
def test_with_the_estimator_the_position_along_the_corridor_is_right(robot: Robot) -> None:
    stage = driven(ceiling(), robot)
    assert numbers(stage) == [0, 1, 2, 3, 4, 5]
    assert abs(stage.log.errors_mm[-1]) < 30.0
    ((at, overshoot),) = stage.log.overshoots
    assert at - overshoot == pytest.approx(PLACES[-1], abs=30.0)


@pytest.mark.parametrize("robot", [Robot(off_mm=300.0), Robot(scale=0.98), Robot(slips=((4000.0, 80.0),))])
def test_alone_it_counts_all_the_same_and_tells_nothing_to_the_base(robot: Robot) -> None:
    stage = driven(ceiling(), robot, alone=True)
    assert numbers(stage) == [0, 1, 2, 3, 4, 5]
    ((at, overshoot),) = stage.log.overshoots
    assert at - overshoot == pytest.approx(PLACES[-1], abs=30.0)
    assert stage.base.corrections == []


def test_the_edges_of_the_lights_tell_the_heading() -> None:
    stage = driven(ceiling(), Robot(tilt_deg=6.0, believed_deg=-1.0))
    assert stage.base.heading == pytest.approx(6.0, abs=0.7)
    left_alone = driven(ceiling(), Robot(tilt_deg=6.0, believed_deg=-1.0), alone=True)
    assert left_alone.base.heading == -1.0


def test_a_fix_is_of_one_image_and_says_where_the_robot_was_then() -> None:
    stage = driven(
        ceiling(), Robot(tilt_deg=4.0, believed_deg=4.0, off_mm=250.0), alone=True, goals=(PLACES[:1],)
    )
    fix = fix_of(stage.variable(LIGHT_FIX))
    along, heading = fix.rows
    then_mm = 300.0 * fix.t_ns / 1e9
    assert along[:3] == pytest.approx((0.0, 1.0, 0.0))
    assert along.value == pytest.approx(then_mm, abs=20.0)
    assert along.sigma == pytest.approx(25.0)
    assert math.degrees(heading.value) == pytest.approx(4.0, abs=0.7)


def test_without_cameras_lights_are_passed_by_the_position_alone() -> None:
    stage = driven(ceiling(), Robot(off_mm=40.0), cameras=())
    assert numbers(stage) == [0, 1, 2, 3, 4, 5]
    for (at, _), place in zip(stage.log.counts[1:], PLACES, strict=True):
        assert place <= at + 40.0 <= place + 100.0
    assert fix_of(stage.variable(LIGHT_FIX)) is None


@pytest.mark.parametrize("out", [(0,), (2,), (4,), (0, 1, 2, 3, 4)])
def test_lights_that_are_out_are_passed_all_the_same(out: tuple[int, ...]) -> None:
    stage = driven(ceiling(*out), Robot(scale=1.005))
    assert numbers(stage) == [0, 1, 2, 3, 4, 5]
    ((at, overshoot),) = stage.log.overshoots
    assert at - overshoot == pytest.approx(PLACES[-1], abs=30.0 if len(out) == 1 else 200.0)


def test_a_robot_that_is_lost_by_a_meter_is_found_by_two_lights() -> None:
    stage = driven(ceiling(), Robot(off_mm=900.0))
    assert abs(stage.log.errors_mm[-1]) < 30.0


def test_a_new_goal_begins_at_zero_and_knows_the_scale() -> None:
    stage = driven(ceiling(), Robot(scale=1.02), goals=(PLACES[:3], PLACES[3:]))
    assert numbers(stage) == [0, 1, 2, 3, 0, 1, 2]
    assert abs(stage.log.errors_mm[-1]) < 20.0
    assert max(map(abs, stage.log.errors_mm[-200:])) < 40.0


def test_what_is_traveled_without_lights_is_corrected_by_the_scale() -> None:
    stage = driven(ceiling(), Robot(scale=1.02), goals=(PLACES[:3],), seconds=60.0)
    for _ in range(4):
        stage.run(8.0, all_of_it=True)
    assert stage.base.along_mm > PLACES[2] + 8000.0
    assert abs(stage.log.errors_mm[-1]) < 50.0


def test_a_goal_without_lights_is_done_at_once() -> None:
    stage = driven(ceiling(), Robot(), goals=((),), seconds=2.0)
    assert [overshoot for _, overshoot in stage.log.overshoots] == [0.0]


def test_a_goal_that_replaces_another_is_taken() -> None:
    stage = driven(ceiling(), Robot(), goals=((60_000.0,), PLACES), patience_s=1.0)
    assert numbers(stage) == [0, 1, 2, 3, 4, 5]


def test_a_tracker_that_starts_again_goes_on_counting() -> None:
    """It is killed half-way to each light, and the next one begins two seconds later."""
    stage = Stage(ceiling(), Robot(scale=1.005), {"tracker": killed()}, seed=3, goals=(PLACES,))
    stage.run(120.0)
    assert numbers(stage) == [0, 1, 2, 3, 4, 5]
    ((at, overshoot),) = stage.log.overshoots
    assert at - overshoot == pytest.approx(PLACES[-1], abs=150.0)
    stage.run(5.0, all_of_it=True)  # one that was killed at the very end is followed by one that ends it
    assert stage.variable(TRACK_START) == []


def killed() -> Script:
    """Trackers of which none lives for more than so many steps, one after the other."""
    for _ in range(40):
        tracker = light_tracker()
        yield from _some_of(tracker, 120)
        tracker.close()
        yield from sleep(2.0)


def _some_of(script: Script, steps: int) -> Script:
    answer: Any = None
    problem: Exception | None = None
    for _ in range(steps):
        step = script.send(answer) if problem is None else script.throw(problem)
        answer = problem = None
        try:
            answer = yield step
        except CallRefusedError as refused:
            problem = refused


def test_lights_are_given_up_for_a_goal_of_another_kind() -> None:
    """Its Planner was ended, and another one has begun, which leads to a goal without lights."""
    stage = Stage(ceiling(), Robot(), {"tracker": light_tracker()}, seed=1, goals=(PLACES,))
    stage.run(10.0)
    stage.tell(GOAL_TYPE, int(GoalKind.NONE))
    stage.run(10.0)
    assert numbers(stage) == [0, 1]
    stage.tell(GOAL_TYPE, int(GoalKind.DEAD_RECKONING))
    stage.run(100.0)
    assert numbers(stage) == [0, 1]
    assert stage.semaphore(END_L_MODE) == 0
    assert stage.variable(TRACK_START) == []


def test_the_end_of_a_goal_is_told_by_the_next_tracker_where_one_had_no_time_for_that() -> None:
    stage = Stage(ceiling(), Robot(), {"tracker": light_tracker()}, seed=1, goals=())
    for name, value in (UNFINISHED | {CEILING_LIGHT: len(PLACES)}).items():
        stage.tell(name, value)
    stage.run(2.0, all_of_it=True)
    assert stage.semaphore(END_L_MODE) == 1
    assert stage.variable(TRACK_START) == []


@pytest.mark.parametrize(
    "other",
    [
        {GOAL_TYPE: int(GoalKind.DEAD_RECKONING)},
        {GOAL_DISTANCE: 3000.0},
        {TRACK_START: []},
    ],
)
def test_what_is_no_unfinished_goal_is_let_be(other: dict[str, object]) -> None:
    stage = Stage(ceiling(), Robot(), {"tracker": light_tracker()}, seed=1, goals=())
    for name, value in (UNFINISHED | other).items():
        stage.tell(name, value)
    stage.run(15.0, all_of_it=True)
    assert numbers(stage) == [0]
    assert stage.variable(TRACK_START) == (UNFINISHED | other)[TRACK_START]


def test_a_goal_that_is_none_is_refused_in_words() -> None:
    stage = Stage(ceiling(), Robot(), {"tracker": light_tracker()}, seed=1, goals=[PLACES], lights=3)
    with pytest.raises(ScriptError, match=r"GoalDistance is 3 and LightOffset \[.*expected a list"):
        stage.run(5.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"cameras": ("a", "b"), "geometry": (UPWARD,)},
        {"geometry": (UPWARD, UPWARD)},
    ],
)
def test_what_is_no_tracker_is_refused_at_once(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="expected"):
        light_tracker(**wrong)


def test_a_position_in_between_is_on_the_way() -> None:
    a = Position(x=0.0, y=0.0, heading=350.0, t_ns=100)
    b = Position(x=10.0, y=20.0, heading=10.0, t_ns=200)
    assert position_at((a, b), 50) == a
    assert position_at((a, b), 300) == b
    middle = position_at((a, b), 150)
    assert (middle.x, middle.y, middle.heading % 360.0) == (5.0, 10.0, 0.0)


# --- ctracker among the real servers in virtual time ---


PROGRAM = """
robot tester {
  frame    50 ms
  sensor   front_bumper : bool    from RServer.front_bumper     within 300 ms
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive       idle drive(velocity = 0, turn = 0)
}
module go { when not front_bumper  do drive(velocity = 400 mm/s, turn = 0 deg/s) }
network { drive = go }
"""

EAST = 270.0
LIGHTS_ALONG = (1800.0, 7000.0)
WALLS = np.array(
    [(-3e3, -2e3, 3e4, -2e3), (3e4, -2e3, 3e4, 2e3), (3e4, 2e3, -3e3, 2e3), (-3e3, 2e3, -3e3, -2e3)]
)
BELIEVED_MM = 150.0


def lead(world: World, log: list[tuple[float, int, float]]) -> Script:
    """Gives one goal, by a position that is off, and notes where the robot is at each light, and by how much
    the position is off soon after; at last the overshoot."""
    for name in (TRACK_DATA, END_L_MODE, LIGHT_DETECTED):
        yield from do("DServer", data.create_semaphore(name, 0))
    yield from do("RServer", robot.adjust_position(BELIEVED_MM, 0.0, 0.0))
    here = yield from do("RServer", robot.position())
    offsets = [LIGHTS_ALONG[0] - here.x, LIGHTS_ALONG[1] - LIGHTS_ALONG[0]]
    goal = {GOAL_DISTANCE: 2, GOAL_DIRECTION: EAST, LIGHT_OFFSET: offsets}
    yield from do("DServer", data.set_many(goal))
    yield from do("DServer", data.signal(TRACK_DATA))
    for _ in LIGHTS_ALONG:
        yield from do("DServer", data.wait(LIGHT_DETECTED))
        passed = yield from do("DServer", data.get(CEILING_LIGHT, type=int))
        at_mm = world.true_pose(0).x_mm
        yield from sleep(0.3)
        here = yield from do("RServer", robot.position())
        log.append((at_mm, passed, here.x - world.true_pose(0).x_mm))
    yield from do("DServer", data.wait(END_L_MODE))
    overshoot = yield from do("DServer", data.get(OVERSHOOT, type=float))
    log.append((overshoot, -1, 0.0))


def estimator() -> Script:
    """Corrects the position by the lights alone."""
    walls = Walls(segments=WALLS, kinds=(EdgeKind.WALL,) * len(WALLS), attributes=("",) * len(WALLS))
    return pose_estimator({"": walls}, sources=frozenset({PoseSource.LIGHTS}))


@pytest.mark.parametrize("order", [1, 2])
def test_it_counts_and_corrects_among_real_servers(order: int) -> None:
    scenery = replace(
        bare_scenery(WALLS, seed=7),
        lights=tuple(CeilingLight(x_mm=x, y_mm=0.0, heading_deg=EAST) for x in LIGHTS_ALONG),
    )
    world, ceiling = World(walls=scenery, poses=[(0.0, 0.0, EAST)], seed=7), CeilingCamera(scenery)
    log: list[tuple[float, int, float]] = []
    run_among_servers(
        PROGRAM,
        world,
        {"tracker": light_tracker(), "estimator": estimator(), "planner": lead(world, log)},
        run_ns=22 * 1_000_000_000,
        seed=7,
        order=order,
        cameras={"CServerUp": lambda now: image_of(ceiling.image(world.true_pose(0), now), now)},
    )
    assert [passed for _, passed, _ in log] == [1, 2, -1]
    for (at, _, off), place in zip(log, LIGHTS_ALONG, strict=False):
        assert place - 25.0 <= at <= place + 60.0
        assert abs(off) < 25.0
    assert log[-1][0] == pytest.approx(log[1][0] - LIGHTS_ALONG[1], abs=30.0)
