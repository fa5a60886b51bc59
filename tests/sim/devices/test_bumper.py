"""Bumpers feel where they are touched: by walls, robots and people."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.sim.hazards.scenery import CorridorTrack, Person, bare_scenery
from tests.sim.devices.stage import Stage

SIDES = ["-20 deg .. 20 deg", "20 deg .. 90 deg", "90 deg .. -90 deg", "-90 deg .. -20 deg"]
AHEAD, LEFT, REAR, RIGHT = ((True, False, False, False), (False, True, False, False),
                            (False, False, True, False), (False, False, False, True))  # fmt: skip
NOWHERE = (False, False, False, False)
APART = 300.5
"""Distance of the hull's center from what touches it, in mm."""


def bumper(sectors: list[str] = SIDES) -> str:
    listed = ", ".join(f'"{sector}"' for sector in sectors)
    return f'[server.Skirt.simulated]\ndevice = "bumper"\nsectors = [{listed}]\n'


def felt(stage: Stage, robot: int = 0) -> object:
    """What is felt after a step in which nothing moves."""
    stage.world.advance(0.01)
    return stage.read("Skirt", "bumper", robot)


def wall_at(bearing: float, heading: float, distance: float = APART) -> tuple[float, float, float, float]:
    """A wall of 4 m across a bearing of a robot at the origin."""
    angle = math.radians(heading + bearing)
    x, y = -math.sin(angle) * distance, math.cos(angle) * distance
    dx, dy = math.cos(angle) * 2000.0, math.sin(angle) * 2000.0
    return (x - dx, y - dy, x + dx, y + dy)


@pytest.mark.parametrize("heading", [0.0, 133.0])
@pytest.mark.parametrize(
    ("bearing", "sector"),
    [(0, AHEAD), (-19, AHEAD), (25, LEFT), (89, LEFT), (91, REAR), (180, REAR), (-91, REAR), (-60, RIGHT)],
)
def test_a_wall_presses_the_sector_in_which_it_touches(
    bearing: float, sector: tuple[bool, ...], heading: float
) -> None:
    stage = Stage(bumper(), walls=[wall_at(bearing, heading)], poses=[(0.0, 0.0, heading)])
    assert felt(stage) == sector
    away = Stage(bumper(), walls=[wall_at(bearing, heading, 302.0)], poses=[(0.0, 0.0, heading)])
    assert felt(away) == NOWHERE


def test_a_corner_presses_two_sectors_and_the_whole_turn_is_one() -> None:
    walls = [wall_at(45.0, 0.0), wall_at(-45.0, 0.0)]
    whole = [*SIDES, "-180 deg .. 180 deg", "0 deg .. 360 deg"]
    assert felt(Stage(bumper(whole), walls=walls)) == (False, True, False, True, True, True)
    assert felt(Stage(bumper(whole))) == (False,) * 6


def test_robots_press_each_other_where_they_touch() -> None:
    poses = [(0.0, 0.0, 0.0), (600.5, 0.0, 0.0)]
    stage = Stage(bumper(["-120 deg .. -60 deg", "60 deg .. 120 deg"]), poses=poses)
    assert felt(stage) == (True, False)
    assert felt(stage, 1) == (False, True)


def test_people_and_glass_press_it() -> None:
    track = CorridorTrack(x_mm=0.0, y_mm=3000.0, heading_deg=0.0, length_mm=10.0, half_width_mm=400.0)
    person = Person(track=track, along_mm=0.0, offset_mm=0.0, forward=True, speed_mm_s=0.0)
    scenery = bare_scenery(np.array([wall_at(90.0, 0.0)]))
    scenery = replace(scenery, silent=np.array([True]), people=(person,))
    stage = Stage(bumper(), walls=scenery)
    radius = stage.world.person_radius_mm
    assert felt(stage) == (False, True, True, False)  # at 90 degrees, where two sectors meet
    away = math.dist(stage.world.people[0], (0.0, 0.0))
    assert away > 1000.0
    meeting = Stage(bumper(), walls=replace(scenery, walls=np.empty((0, 4)), silent=np.empty(0, dtype=bool)))
    meeting.world.command(0, 1000.0, 0.0)
    for _ in range(400):
        if felt(meeting) != NOWHERE:
            break
    x, y = meeting.world.people[0]
    assert felt(meeting) == AHEAD
    pose = meeting.world.true_pose(0)
    assert math.dist((x, y), (pose.x_mm, pose.y_mm)) == pytest.approx(300.0 + radius, abs=1.0)


def test_a_robot_that_drives_into_a_wall_feels_it_where_its_base_does() -> None:
    stage = Stage(bumper(), walls=[(-5000.0, 800.0, 5000.0, 900.0)], poses=[(0.0, 0.0, 30.0)])
    stage.world.command(0, 300.0, 0.0)
    stage.advance(4.0)
    assert stage.world.bumper(0).front
    assert stage.read("Skirt", "bumper") == RIGHT  # the wall is ahead of the nose's right
    stage.world.command(0, -300.0, 0.0)
    stage.advance(1.0)
    assert stage.read("Skirt", "bumper") == NOWHERE
