"""Runs in company: people who walk around, and other robots of other kinds, each with its own behavior."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from colony.body.model import Circle
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file, load_text
from colony.ir.program import Program
from colony.runs.building_run import run_in_building
from colony.runs.described import described_robot
from colony.runs.scenario import read_scenario
from colony.runs.spec import MisuseError, OtherRobot, RunReport, RunSpec
from colony.runtime.observe.summary import render
from colony.sim.world_spec import WorldSpec
from tests.paths import MAPS, ROOT
from tests.runs.test_building_run import Watcher
from tests.sim.robots import ROME

WANDER = ROOT / "behaviors" / "wander.colony"
STRAIGHT = """language 1
import robot
module straight { when true do drive(velocity = 400 mm/s, turn = 0) }
network { drive = straight }
"""
LIFT = """module raise { when true do lift(position = lift_place.up) }
module wait { when lift_position < 60 mm do drive(velocity = 0, turn = 0) }
network {
  lift = raise
  drive = wait suppresses straight
}
"""


@cache
def program(robot: str, text: str | None = None) -> Program:
    return load_file(WANDER, robot=robot) if text is None else load_text(text, robot=robot)


def other(robot: str, name: str, **options: object) -> OtherRobot:
    text = options.pop("text", None)
    assert text is None or isinstance(text, str)
    behavior = program(robot, text)
    found = OtherRobot(
        name=name, file=str(WANDER), described=described_robot(behavior.robot), program=behavior
    )
    return replace(found, **options)  # type: ignore[arg-type]


def spec(*others: OtherRobot, seconds: float = 20.0, **world: object) -> RunSpec:
    return RunSpec(
        file=str(WANDER),
        world=WorldSpec(map_path=str(MAPS / "loop.stickrep"), seed=1).changed(**world),
        length_ns=round(seconds * 1e9),
        others=others,
    )


def driven(robot: str, asked: RunSpec, text: str | None = None) -> RunReport:
    compiled = compile_program(program(robot, text)).compiled
    return run_in_building(compiled, described_robot(compiled.robot), asked, Watcher(10**6).ui)


@pytest.mark.long
def test_a_robot_wanders_among_others_and_people_without_a_bump() -> None:
    asked = spec(other("rome", "rome"), other("rome", "rome_2"), seconds=20.0, movers=5)
    report = driven("amr", asked)
    assert report.summary.bumps == 0
    assert report.summary.distance_mm is not None
    assert report.summary.distance_mm > 6_000.0
    assert [(o.name, o.robot, o.behavior) for o in report.summary.others] == [
        ("rome", "rome", "wander"),
        ("rome_2", "rome", "wander"),
    ]
    for found in report.summary.others:
        places = report.other_paths[found.name]
        assert found.distance_mm > 6_000.0
        assert sum(map(math.dist, places, places[1:])) == pytest.approx(found.distance_mm, rel=0.05)


def test_the_paths_of_people_are_reported() -> None:
    report = driven("amr", spec(seconds=5.0, movers=3))
    walks = report.people["loop"]
    assert len(walks) == 3
    assert all(math.dist(walk[0], walk[-1]) <= 5.0 * 1_400.0 for walk in walks)
    assert max(math.dist(walk[0], walk[-1]) for walk in walks) > 1_000.0
    assert driven("amr", spec(seconds=0.2)).people == {}


def test_a_seed_gives_one_run() -> None:
    asked = spec(other("rome", "rome"), other("amr", "amr_2"), movers=3, seconds=3.0)
    once, again = driven("amr", asked), driven("amr", asked)
    assert once.summary == again.summary
    assert once.paths == again.paths
    assert once.other_paths == again.other_paths
    changed = driven("amr", asked.with_world(seed=2))
    assert changed.other_paths != once.other_paths


def test_nobody_else_changes_nothing() -> None:
    alone = driven("rome", spec(seconds=5.0))
    assert alone.other_paths == {}
    assert alone.summary.others == ()
    far = driven("rome", spec(other("amr", "amr", start=(20_000.0, 1_250.0, 0.0)), seconds=1.0))
    assert far.summary.bumps == 0
    assert far.paths["loop"][0] == alone.paths["loop"][0]


def test_others_drive_at_their_own_speed_and_are_in_the_way() -> None:
    """A rome behind an amr that is slower: its limits keep it away from the hull of the amr."""
    slow = STRAIGHT.replace("400 mm/s", "50 mm/s")
    x, y, heading = 4_000.0, 1_250.0, 270.0
    report = driven(
        "rome",
        spec(
            other("amr", "amr", text=slow, start=(x + 2_000.0, y, heading)),
            seconds=10.0,
            start=(x, y, heading),
        ),
        STRAIGHT,
    )
    [found] = report.summary.others
    assert found.distance_mm == pytest.approx(500.0, rel=0.05)
    rome, amr = report.paths["loop"][-1], report.other_paths["amr"][-1]
    assert report.summary.distance_mm is not None
    assert 1_000.0 < report.summary.distance_mm < 2_500.0
    assert math.dist(rome, amr) >= 400.0 + ROME.radius_mm - 1.0


def test_others_start_where_they_are_told_to() -> None:
    start = (20_000.0, 1_250.0, 45.0)
    report = driven("rome", spec(other("amr", "amr", start=start), seconds=0.2))
    assert report.other_paths["amr"][0] == pytest.approx(start[:2])


def test_what_does_not_fit_is_misuse() -> None:
    inside = other("amr", "amr", start=(0.0, 0.0, 0.0))
    with pytest.raises(MisuseError, match=r"1 is amr\) cannot start there: robot 1 at \(0, 0\) is 0 mm from"):
        driven("rome", spec(inside))
    body = inside.described.body
    huge = replace(body, chassis=replace(body.chassis, footprint=Circle(radius_mm=9e3)))
    described = inside.described._replace(body=huge)
    with pytest.raises(MisuseError, match="--also amr: error: nothing with a radius of 9000 mm can move"):
        driven("rome", spec(other("amr", "amr", described=described)))


def test_the_loop_of_another_robot_does_what_its_servers_do() -> None:
    """The same amr with its lidar, cliff sensors, panel and lift: run by servers, and as a companion."""
    start, rome = (4_000.0, 1_250.0, 270.0), (20_000.0, 1_250.0, 90.0)
    lifting = STRAIGHT.replace("network { drive = straight }", LIFT)
    alone = driven("amr", spec(seconds=6.0, start=start), lifting)
    beside = driven(
        "rome",
        spec(other("amr", "amr", text=lifting, start=start), seconds=6.0, start=rome),
        STRAIGHT.replace("400 mm/s", "0 mm/s"),
    )
    [found] = beside.summary.others
    assert alone.summary.distance_mm is not None
    assert alone.summary.distance_mm > 1_000.0
    assert found.distance_mm == pytest.approx(alone.summary.distance_mm, rel=0.02)


GIVEN = """language 1
import robot
module cruise { when not estop and goal_x > 6 m  do drive(velocity = 200 mm/s, turn = 0 deg/s) }
network { drive = cruise }
"""


def test_another_robot_is_given_what_its_scenario_says(tmp_path: Path) -> None:
    robot = program("amr", GIVEN).robot
    (tmp_path / "shift.scenario").write_text(
        "at 0 s estop = true, goal_x = 7 m, resume = false\nat 1.5 s estop = false\nat 2 s resume = true\n"
    )
    scenario = read_scenario(str(tmp_path / "shift.scenario"), robot)
    start = (4_000.0, 1_250.0, 270.0)
    report = driven(
        "rome",
        spec(
            other("amr", "given", text=GIVEN, start=start, scenario=scenario),
            other("amr", "forgotten", text=GIVEN),
            seconds=4.0,
            start=(20_000.0, 1_250.0, 90.0),
        ),
    )
    given, forgotten = report.summary.others
    assert given.unread == ()
    assert given.distance_mm == pytest.approx(400.0, rel=0.2)  # in the last two seconds
    assert forgotten.unread == ("goal_x",)
    assert forgotten.distance_mm == 0.0
    assert "0.00 m, 0 bumps; `goal_x` never had a value" in render(report.summary)
