"""The pose estimator in the simulator: RoME with its errors, on the corridors of the loop.

The bounds are about twice what was measured, so that they hold for other seeds too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import Walls, walls_of
from colony.nav.pose.estimate import pose_estimator
from colony.nav.pose.pose import Fix, MeasurementRow, fix_list, pose_of
from colony.nav.pose.tracker import PoseSource
from colony.nav.shared import LIGHT_FIX, MARKER_FIX, PLATE_FIX, GoalKind
from colony.runtime.kit.errors import (
    CallRefusedError,
    CallTimeoutError,
    ConnectionLostError,
    RobotConnectionError,
    ServerNotFoundError,
)
from colony.runtime.kit.script import Do, Script, Sleep, Step
from colony.runtime.library import proximity
from colony.runtime.library import robot as robot_asks
from colony.runtime.library.robot import Position
from colony.sim.config import RobotConfig
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.world.world import World
from tests.nav.pose.bench import Bench, drive, with_doors_open
from tests.paths import MAPS
from tests.sim.robots import IDEAL, ROME

LOOP = MAPS / "loop.stickrep"
THIRD_FLOOR = LOOP.with_name("msu_engineering_3.stickrep")
WALLS = walls_of(load_map(LOOP))
ROUGH = replace(ROME, wheel_scale=0.0105)
"""RoME whose wheels are out by another 1 %: it drifts by more than two degrees a meter."""

WEST, SOUTH, NORTH, EAST = 1_270.0, 1_270.0, 18_745.2, 28_702.0
"""The middles of the corridors."""

EASTWARD = (6_000.0, SOUTH, 270.0)
WORLD_AT_EAST = World(walls=WALLS.segments, poses=[EASTWARD], config=IDEAL)


def estimator(walls: Walls, period_s: float = 0.1) -> Script:
    """Of a building that has one floor."""
    return pose_estimator({"here": walls}, period_s=period_s)


def bench(
    *, start: tuple[float, float, float] = EASTWARD, config: RobotConfig = ROUGH, seed: int = 0,
    segments: np.ndarray | None = None, walls: Walls = WALLS, cross_talk: float = 0.005, lag: bool = False,
) -> Bench:  # fmt: skip
    world = World(
        walls=WALLS.segments if segments is None else segments, poses=[start], config=config, seed=seed
    )
    return Bench(world, estimator(walls), cross_talk=cross_talk, seed=seed, lag=lag)


def believe(robot: Bench, x: float, y: float, turn: float) -> None:
    """Let the robot believe that it is elsewhere, by so much."""
    at = robot.world.true_pose(0)
    robot.world.set_odometry(0, (at.x_mm + x, at.y_mm + y, at.heading_deg + turn))


@pytest.mark.parametrize("seed", [0, 1])
def test_along_corridors_with_open_doors_the_heading_and_the_offset_are_held(seed: int) -> None:
    robot = bench(seed=seed, segments=with_doors_open(WALLS, 0.12, seed))
    log = drive(robot, [(EAST, SOUTH), (EAST, 12_000.0)])
    assert np.percentile(log.heading, 95) < 1.0
    on_the_south_side = log.way < 20_000.0
    assert np.percentile(log.y[on_the_south_side], 95) < 10.0
    assert robot.adjusted < len(log.way)


def test_without_it_the_heading_is_lost() -> None:
    world = World(walls=WALLS.segments, poses=[EASTWARD], config=ROUGH, seed=0)
    assert drive(Bench(world, estimator(WALLS, period_s=1e6)), [(16_000.0, SOUTH)]).heading[-1] > 10.0


@pytest.mark.parametrize("turn", [5.0, -10.0, 10.0, -20.0, 33.0])
def test_a_slip_is_found_within_a_meter(turn: float) -> None:
    robot = bench(segments=with_doors_open(WALLS, 0.12, 1))
    drive(robot, [(8_000.0, SOUTH)])
    robot.slip(turn, back_mm=60.0)
    assert abs(robot.heading_error_deg) > 0.9 * abs(turn)
    log = drive(robot, [(13_000.0, SOUTH)])
    late = log.way - log.way[0] > 1_000.0
    assert log.heading[late].max() < 1.5
    assert log.y[late].max() < 60.0


def test_in_a_turning_space_the_position_is_fixed() -> None:
    """East of the last light all is dead reckoning, and the place along the corridor is off by 250 mm."""
    robot = bench(start=(22_000.0, SOUTH, 270.0), config=ROME)
    believe(robot, -250.0, 40.0, 3.0)
    log = drive(robot, [(EAST, SOUTH), (EAST, SOUTH + 800.0)])
    assert log.x[0] > 200.0
    x, y = robot.position_error_mm
    assert math.hypot(x, y) < 100.0
    assert abs(robot.heading_error_deg) < 1.5


def test_a_short_dark_corridor_is_enough() -> None:
    """Less than a map of three lights, and less than the two lights of a trouble spot: 1.5 m."""
    robot = bench(start=(EAST, 6_000.0, 0.0))
    believe(robot, 50.0, 0.0, -8.0)
    drive(robot, [(EAST, 7_650.0)])
    assert abs(robot.heading_error_deg) < 1.0
    assert abs(robot.position_error_mm[0]) < 20.0


@pytest.mark.parametrize("leaf", [30.0, 60.0, 85.0])
def test_the_leaves_of_open_doors_are_not_taken_for_walls(leaf: float) -> None:
    log = drive(bench(segments=with_doors_open(WALLS, 1.0, 0, leaf_deg=leaf)), [(EAST, SOUTH)])
    assert log.heading.max() < 2.0
    assert log.y.max() < 30.0


def test_glass_that_is_not_seen_does_no_harm() -> None:
    """The outer wall of the south side is of glass, and returns no echo."""
    glass = WALLS.segments[:, [1, 3]].max(axis=1) < 1.0
    walls = Walls(
        segments=WALLS.segments,
        kinds=WALLS.kinds,
        attributes=tuple("glass" if pane else "" for pane in glass),
    )
    robot = bench(walls=walls, segments=WALLS.segments[~glass])
    log = drive(robot, [(24_000.0, SOUTH)])
    assert np.percentile(log.heading, 95) < 2.0
    assert log.y.max() < 40.0


@pytest.mark.parametrize(
    "go_wrong",
    [lambda robot: robot.slip(38.0), lambda robot: robot.adjust(0.0, 450.0, 15.0)],
    ids=["heading, by half a right angle", "place across the corridor, by far"],
)
def test_what_is_wrong_is_found_by_the_lines_of_a_map(go_wrong: Callable[[Bench], object]) -> None:
    robot = bench(config=ROME)
    drive(robot, [(8_000.0, SOUTH)])
    go_wrong(robot)
    log = drive(robot, [(16_000.0, SOUTH)])
    assert log.heading[-1] < 1.5
    assert log.y[-1] < 60.0


def test_what_other_clients_correct_is_taken_over() -> None:
    robot = bench()
    drive(robot, [(8_000.0, SOUTH)])
    believe_x = robot.position_error_mm[0]
    robot.adjust(300.0 - believe_x, 0.0, 0.0)
    drive(robot, [(11_000.0, SOUTH)])
    assert robot.position_error_mm[0] == pytest.approx(300.0, abs=60.0)
    robot.adjust(5_000.0 - robot.position_error_mm[0], 0.0, 0.0)  # along a corridor that looks alike
    drive(robot, [(13_000.0, SOUTH)])
    assert robot.position_error_mm[0] == pytest.approx(5_000.0, abs=100.0)
    assert abs(robot.position_error_mm[1]) < 30.0


def test_scans_that_are_older_than_the_position_are_put_where_they_belong() -> None:
    """A frame is 3 degrees on the spot, and 20 mm along the corridor."""
    robot = bench(start=(24_000.0, SOUTH, 270.0), config=ROME, lag=True)
    log = drive(robot, [(EAST, SOUTH), (EAST, 6_000.0), (EAST, 4_000.0)])
    assert np.percentile(log.heading, 95) < 1.2
    assert np.percentile(np.hypot(log.x, log.y), 95) < 60.0


@pytest.mark.parametrize("seed", [1])
def test_the_third_floor_with_all_that_goes_wrong_there(seed: int) -> None:
    """Along the main corridor, which a glass door ends, with people in it."""
    floor = load_map(THIRD_FLOOR)
    world = World(walls=draw(Hazards(), floor, seed), poses=[(122_165.0, 70_000.0, 0.0)], seed=seed)
    log = drive(Bench(world, estimator(walls_of(floor))), [(122_165.0, 108_000.0)])
    assert np.percentile(log.heading, 95) < 1.5
    assert np.percentile(log.x, 95) < 60.0


# --- step by step ------------------------------------------------------------------------------------

EAST_POSE = Position(x=6_000.0, y=SOUTH, heading=270.0, t_ns=1)
SCAN = proximity.SonarReading(t_ns=1, ranges=tuple(WORLD_AT_EAST.sonar(0).tolist()))


class Stepped:
    """The estimator, one question at a time, with a DServer that knows what `variables` say. Mutable."""

    def __init__(self, script: Script, **variables: object) -> None:
        self._script, self.variables = script, variables
        self.asked: Step | None = self._on(next(script))

    def answer(self, value: object) -> Step:
        """What it asks next of others than DServer."""
        self.asked = self._on(self._script.send(value))
        return self.asked

    def refuse(self, problem: Exception) -> Step:
        """Likewise."""
        self.asked = self._on(self._script.throw(problem))
        return self.asked

    def _on(self, step: Step) -> Step:
        while isinstance(step, Do) and step.server == "DServer":
            arguments: Any = step.call.arguments
            names = getattr(arguments, "names", None) or (arguments.name,)
            if step.call.method == "set":
                self.variables[names[0]] = msgspec.msgpack.decode(arguments.value)
                step = self._script.send(None)
            elif any(name not in self.variables for name in names):
                step = self._script.throw(CallRefusedError("unset", f"{names} were never set"))
            else:
                found = {name: self.variables[name] for name in names}
                step = self._script.send(found if step.call.method == "get_many" else found[names[0]])
        return step


def test_sonars_that_have_nothing_to_say_are_done_without() -> None:
    robot = Stepped(estimator(WALLS))
    assert robot.asked == Sleep(0.1)
    assert robot.answer(0) == Do("PServer", proximity.sonar())
    assert robot.answer(None) == Do("RServer", robot_asks.position())
    assert robot.answer(EAST_POSE) == Sleep(0.1)
    pose = pose_of(robot.variables["Pose"])
    assert pose[:4] == (1, 6_000.0, SOUTH, 270.0)


@pytest.mark.parametrize(
    "problem",
    [
        ServerNotFoundError("away"),
        ConnectionLostError("lost"),
        CallTimeoutError("late"),
        CallRefusedError("no value", ""),
    ],
)
def test_servers_that_are_away_are_waited_for(problem: RobotConnectionError) -> None:
    robot = Stepped(estimator(WALLS))
    assert robot.answer(0) == Do("PServer", proximity.sonar())
    assert robot.refuse(problem) == Do("RServer", robot_asks.position())
    assert robot.refuse(problem) == Sleep(0.1)
    assert robot.answer(0) == Do("PServer", proximity.sonar())
    assert robot.answer(SCAN) == Do("RServer", robot_asks.position())
    turned = Position(x=EAST_POSE.x, y=EAST_POSE.y, heading=EAST_POSE.heading + 4.0, t_ns=1)
    adjust = robot.answer(turned)
    assert isinstance(adjust, Do)
    assert adjust.call.method == "adjust_position"
    assert robot.refuse(problem) == Sleep(0.1)  # and publishes it again
    robot.answer(0)
    robot.answer(proximity.SonarReading(t_ns=2, ranges=SCAN.ranges))
    again = robot.answer(Position(x=turned.x, y=turned.y, heading=turned.heading, t_ns=2))
    assert isinstance(again, Do)
    assert isinstance(again.call.arguments, robot_asks.PoseArguments)
    assert again.call.arguments.heading < -1.0


def test_without_dserver_it_goes_on_by_the_sonars() -> None:
    script = estimator(WALLS)
    next(script)
    step = script.send(0)
    answers = {"sonar": SCAN, "position": Position(x=6_000.0, y=SOUTH, heading=274.0, t_ns=1)}
    for _ in range(30):
        assert isinstance(step, Do)
        if step.call.method == "adjust_position":
            return
        step = (
            script.throw(ConnectionLostError("lost"))
            if step.server == "DServer"
            else script.send(answers[step.call.method])
        )
    pytest.fail("the position was not corrected")


def test_what_is_refused_for_ever_is_told() -> None:
    robot = Stepped(estimator(WALLS))
    robot.answer(0)
    with pytest.raises(CallRefusedError):
        robot.refuse(CallRefusedError("permission", "not yours"))


def test_a_floor_that_is_not_in_the_building_is_refused_in_words() -> None:
    robot = Stepped(estimator(WALLS), Floor="cellar")
    with pytest.raises(ValueError, match="Floor is 'cellar'; expected one of here"):
        robot.answer(0)


def test_a_building_without_floors_is_refused_at_once() -> None:
    with pytest.raises(ValueError, match="expected the walls of at least one"):
        pose_estimator({})


def test_who_stands_where_he_believes_to_be_is_not_corrected() -> None:
    robot = bench(config=IDEAL, cross_talk=0.0)
    for _ in range(100):
        robot.frame(0.0, 0.0)
    assert robot.adjusted == 0


# --- landmarks, floors, elevators -----------------------------------------------------------------------


class Witness(Bench):
    """A bench with fixes at DServer: every `every` frames the robot's position `late` frames before, as
    a light measures it, with an error of `sigma_mm`. Mutable: where the robot was."""

    def __init__(
        self, world: World, script: Script, *, name: str = LIGHT_FIX, every: int = 40, late: int = 6,
        sigma_mm: float = 25.0, seed: int = 0,
    ) -> None:  # fmt: skip
        super().__init__(world, script, seed=seed)
        self._name, self._every, self._late, self._sigma_mm = name, every, late, sigma_mm
        self._errors = np.random.default_rng(seed)
        self._poses: list[tuple[int, float, float]] = []

    def frame(self, velocity: float, turn: float) -> None:
        super().frame(velocity, turn)
        at = self.world.true_pose(0)
        self._poses.append((self.now_ns, at.x_mm, at.heading_deg))
        if len(self._poses) % self._every == 0 and len(self._poses) > self._late:
            t_ns, x, heading = self._poses[-1 - self._late]
            place, tilt = self._errors.normal(0.0, [self._sigma_mm, math.radians(0.5)]).tolist()
            rows = (
                MeasurementRow(1.0, 0.0, 0.0, x + place, self._sigma_mm),
                MeasurementRow(0.0, 0.0, 1.0, math.radians(heading) + tilt, math.radians(0.5)),
            )
            self.tell(self._name, fix_list(Fix(t_ns, rows)))


@pytest.mark.parametrize(
    ("source", "name"),
    [(PoseSource.LIGHTS, LIGHT_FIX), (PoseSource.PLATES, PLATE_FIX), (PoseSource.MARKERS, MARKER_FIX)],
)
def test_landmarks_alone_hold_the_place_along_the_corridor(source: PoseSource, name: str) -> None:
    world = World(walls=WALLS.segments, poses=[EASTWARD], config=replace(ROME, wheel_scale=0.0105), seed=3)
    script = pose_estimator({"here": WALLS}, sources=frozenset({source}))
    log = drive(Witness(world, script, name=name), [(24_000.0, SOUTH)])
    assert log.x[len(log.x) // 3 :].max() < 60.0
    assert np.percentile(log.heading, 95) < 3.0


def test_a_source_that_is_left_out_is_not_heard() -> None:
    world = World(walls=WALLS.segments, poses=[EASTWARD], config=ROUGH, seed=0)
    script = pose_estimator({"here": WALLS}, sources=frozenset({PoseSource.PLATES}))
    robot = Witness(world, script)
    drive(robot, [(12_000.0, SOUTH)])
    assert robot.adjusted == 0
    assert abs(robot.heading_error_deg) > 3.0


def test_without_scans_local_maps_hold_the_heading_and_the_offset() -> None:
    world = World(walls=WALLS.segments, poses=[EASTWARD], seed=0)
    script = pose_estimator({"here": WALLS}, sources=frozenset({PoseSource.LOCAL_MAPS}))
    log = drive(Bench(world, script), [(24_000.0, SOUTH)])
    assert np.percentile(log.heading, 95) < 4.0
    assert np.percentile(log.y, 95) < 120.0


def consistency(seed: int) -> list[float]:
    """How far off the estimate is along a corridor, twice a second, in squared standard deviations."""
    world = World(walls=WALLS.segments, poses=[EASTWARD], seed=seed)
    robot = Witness(world, estimator(WALLS), seed=seed)
    found: list[float] = []
    for _ in range(900):
        robot.frame(400.0, 2.0 * math.remainder(270.0 - robot.believed.heading, 360.0))
        pose = pose_of(robot.told("Pose"))
        if pose is None or pose.t_ns != robot.now_ns or len(found) * 10 > robot.now_ns / 50e6:
            continue
        at = world.true_pose(0)
        turn = math.remainder(at.heading_deg - pose.heading_deg, 360.0)
        off = np.array([at.x_mm - pose.x_mm, at.y_mm - pose.y_mm, turn])
        upper = [[pose.xx, pose.xy, pose.xh], [pose.xy, pose.yy, pose.yh], [pose.xh, pose.yh, pose.hh]]
        found.append(float(off @ np.linalg.solve(np.array(upper), off)))
    return found


def test_the_covariance_says_how_far_off_the_estimate_is() -> None:
    """Three numbers are off by three squared standard deviations in the mean, if it is right."""
    found = [square for seed in (1, 2) for square in consistency(seed)]
    assert 0.3 < np.mean(found) < 6.0
    assert np.mean(np.array(found) < 7.815) > 0.9


def test_on_another_floor_the_walls_of_that_floor_count() -> None:
    """The other floor is the same one, 500 mm farther north; the Planner has moved RServer's position."""
    above = Walls(segments=WALLS.segments + (0.0, 500.0) * 2, kinds=WALLS.kinds, attributes=WALLS.attributes)
    world = World(walls=WALLS.segments, poses=[EASTWARD], config=ROME)
    robot = Bench(world, pose_estimator({"first": WALLS, "second": above}))
    drive(robot, [(9_000.0, SOUTH)])
    assert abs(robot.position_error_mm[1]) < 30.0
    before = pose_of(robot.variable("Pose"))
    robot.adjust(0.0, 560.0, 2.0)
    robot.tell("Floor", "second")
    robot.frame(0.0, 0.0)
    robot.frame(0.0, 0.0)
    after = pose_of(robot.variable("Pose"))
    assert after.xx > 4.0 * before.xx
    drive(robot, [(12_000.0, SOUTH)])
    assert robot.position_error_mm[1] == pytest.approx(500.0, abs=30.0)
    assert abs(robot.heading_error_deg) < 1.5


def test_in_an_elevator_the_sonars_say_nothing_of_the_map() -> None:
    robot = bench(config=ROME)
    robot.tell("GoalType", int(GoalKind.ELEVATOR))
    believe(robot, 0.0, 80.0, 3.0)
    drive(robot, [(9_000.0, SOUTH)])
    assert robot.adjusted == 0
    robot.tell("GoalType", int(GoalKind.DEAD_RECKONING))
    drive(robot, [(12_000.0, SOUTH)])
    assert abs(robot.position_error_mm[1]) < 30.0


def told_twice(fixes: list[object]) -> tuple[float, float]:
    """Return the estimated x and y of a robot after these corrections."""
    script = pose_estimator({"here": WALLS}, sources=frozenset({PoseSource.LIGHTS}))
    robot = Stepped(script)
    for k, fix in enumerate([[], *fixes], 1):
        robot.variables[LIGHT_FIX] = fix
        robot.answer(0)
        step = robot.answer(Position(x=EAST_POSE.x, y=EAST_POSE.y, heading=270.0, t_ns=k * 100_000_000))
        if step != Sleep(0.1):
            assert robot.refuse(ConnectionLostError("lost")) == Sleep(0.1)  # uncorrected, it stays wrong
    pose = pose_of(robot.variables["Pose"])
    return pose.x_mm, pose.y_mm


FIX = [100_000_000, 1.0, 0.0, 0.0, 6_040.0, 25.0]


def test_a_fix_counts_once() -> None:
    once = told_twice([FIX])
    assert once[0] > 6_020.0
    assert told_twice([FIX, FIX, FIX]) == pytest.approx(once)
    assert told_twice([FIX, [200_000_000, *FIX[1:]]])[0] > once[0] + 1.0


@pytest.mark.parametrize(
    "wrong",
    [
        FIX[:-1],
        [FIX[0]],
        [100_000_000, 1.0, 0.0, 0.0, math.nan, 25.0],
        [100_000_000, 1.0, 0.0, 0.0, 6_040.0, 0.0],
        [math.inf, 1.0, 0.0, 0.0, 6_040.0, 25.0],
        ["now", 1.0, 0.0, 0.0, 6_040.0, 25.0],
        [100_000_000, None, 0.0, 0.0, 6_040.0, 25.0],
        {"t": 1},
        7.0,
        None,
        [-9_000_000_000, 1.0, 0.0, 0.0, 6_040.0, 25.0],  # long ago
    ],
)
def test_what_is_no_fix_is_passed_over(wrong: object) -> None:
    assert told_twice([wrong]) == (EAST_POSE.x, EAST_POSE.y)


def test_a_fix_of_a_moment_to_come_waits_for_it() -> None:
    soon = [300_000_000, *FIX[1:]]
    assert told_twice([soon]) == (EAST_POSE.x, EAST_POSE.y)
    assert told_twice([soon, soon])[0] > 6_020.0


def test_a_fix_of_a_clock_that_is_wrong_does_not_keep_others_out() -> None:
    assert told_twice([[10**15, *FIX[1:]], FIX]) == pytest.approx(told_twice([[], FIX]))
