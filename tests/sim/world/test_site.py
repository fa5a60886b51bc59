"""The floors of a plan in one run."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from colony.nav.maps.building import Building, load_building
from colony.nav.plan.route import plan
from colony.sim.hazards.hazards import Hazards
from colony.sim.world.site import SimulatedSite
from tests.nav.floors import two_floors
from tests.paths import MAPS

BUILDING = load_building(MAPS / "msu_engineering_3.stickrep")
THIRD, SECOND = "msu_engineering_3", "msu_engineering_2"


def site_of(building: Building, hazards: Hazards, seed: int, *way: str) -> SimulatedSite:
    planned = plan(building, *way)
    return SimulatedSite(building, planned.floors, hazards, poses=[planned.start], seed=seed)


def test_a_floor_is_the_same_wherever_the_plan_begins_and_each_has_luck_of_its_own() -> None:
    down = site_of(BUILDING, Hazards(), 7, "350R", "2:250R")
    up = site_of(BUILDING, Hazards(), 7, "2:250R", "350R")
    assert (down.floor, up.floor) == (THIRD, SECOND)
    assert [floor.name for floor in up.building.maps] == [SECOND, THIRD]
    for name in (THIRD, SECOND):
        assert np.array_equal(down.sceneries[name].walls, up.sceneries[name].walls)
    assert down.sceneries[THIRD].seed != down.sceneries[SECOND].seed


def test_only_the_floors_of_the_plan_are_there() -> None:
    site = site_of(BUILDING, Hazards.none(), 1, "350R", "352L")
    assert list(site.maps) == [THIRD]
    assert site.building.rides == ()
    first = plan(BUILDING, "350R", "352L").segments[0]
    x, y, heading = site.world.true_pose(0)
    assert (x, y, heading) == (first.start.x_mm, first.start.y_mm, first.heading_deg)


def test_a_camera_is_that_of_the_floor_on_which_the_robot_is(tmp_path: Path) -> None:
    building = two_floors(tmp_path)
    site = site_of(building, Hazards.none(), 1, "A", "upper:C")
    made: list[str] = []

    def eye(floor: object, scenery: object) -> str:
        made.append(site.floor)
        return site.floor

    here = site.camera_per_floor(eye)
    assert (here(), here()) == ("ground", "ground")
    cabin = site.elevators.cabin("liftL")
    site.elevators.open("liftL")
    site.elevators.advance(5.0)
    site.world.place(0, (*cabin.point_at(0.0, 900.0), cabin.heading_deg))
    site.elevators.close("liftL")
    site.elevators.advance(5.0)
    site.elevators.ride("liftL", "upper")
    assert (here(), here()) == ("upper", "upper")
    assert made == ["ground", "upper"]
    assert site.ceiling() is site.ceiling()
