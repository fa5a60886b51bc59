"""Elevators: doors that slide, cabins to drive into, and rides from one floor to another."""

from __future__ import annotations

import math

import pytest

from colony.nav.maps.building import load_building
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.world.elevators import CABIN_DEPTH_MM, CABIN_WIDTH_MM, SLIDE_S, Elevators, cabin_of
from colony.sim.world.world import World
from tests.buildings import LOOP
from tests.paths import MAPS
from tests.sim.robots import IDEAL, RING

BUILDING = load_building(MAPS / "msu_engineering_3.stickrep")
THIRD, SECOND = "msu_engineering_3", "msu_engineering_2"
FLOORS = {floor.name: draw(Hazards.none(), floor, 1) for floor in BUILDING.maps}
NODE = "acs.elev.L"
CABIN = cabin_of(BUILDING.map_named(THIRD), NODE)
BEFORE = (*CABIN.point_at(0.0, -900.0), CABIN.heading_deg)
"""In front of the doors, looking at them."""
INSIDE = (*CABIN.point_at(0.0, CABIN_DEPTH_MM / 2), CABIN.heading_deg)


def staged(pose: tuple[float, float, float] = BEFORE) -> tuple[World, Elevators]:
    world = World(walls=FLOORS[THIRD], poses=[pose], config=IDEAL)
    return world, Elevators(world, BUILDING, FLOORS, THIRD)


def wait(world: World, elevators: Elevators, seconds: float) -> None:
    for _ in range(round(seconds / 0.05)):
        world.advance(0.05)
        elevators.advance(0.05)


def deep(world: World, floor: str = THIRD) -> float:
    x, y, _ = world.true_pose(0)
    return cabin_of(BUILDING.map_named(floor), NODE).coordinates(x, y)[1]


def driven_in() -> tuple[World, Elevators]:
    world, elevators = staged()
    elevators.open(NODE)
    wait(world, elevators, SLIDE_S)
    world.command(0, 300.0, 0.0)
    wait(world, elevators, 6.0)
    world.command(0, 0.0, 0.0)
    wait(world, elevators, 1.0)
    return world, elevators


def test_doors_take_their_time() -> None:
    world, elevators = staged()
    shut = 900.0 - RING.ring_mm
    assert world.sonar(0)[12] == pytest.approx(shut)
    elevators.open(NODE)
    assert elevators.opening(NODE) == 0.0
    wait(world, elevators, SLIDE_S / 2)
    assert elevators.opening(NODE) == pytest.approx(0.5)
    assert world.sonar(0)[12] > shut + 1000.0  # between the doors
    wait(world, elevators, SLIDE_S)
    assert elevators.opening(NODE) == 1.0
    assert world.sonar(0)[12] == pytest.approx(shut + CABIN_DEPTH_MM)
    elevators.close(NODE)
    wait(world, elevators, 2 * SLIDE_S)
    assert elevators.opening(NODE) == 0.0
    assert world.sonar(0)[12] == pytest.approx(shut)


def test_a_cabin_is_as_large_as_it_is_said_to_be() -> None:
    world, _ = driven_in()
    world.place(0, INSIDE)
    readings = world.sonar(0)
    middle = CABIN_DEPTH_MM / 2 - RING.ring_mm
    assert readings[12] == pytest.approx(middle)
    assert readings[18] == pytest.approx(CABIN_WIDTH_MM / 2 - RING.ring_mm)
    assert readings[6] == pytest.approx(CABIN_WIDTH_MM / 2 - RING.ring_mm)


def test_a_robot_drives_in_rides_and_drives_out_on_another_floor() -> None:
    world, elevators = driven_in()
    assert deep(world) == pytest.approx(CABIN_DEPTH_MM / 2)
    elevators.close(NODE)
    wait(world, elevators, SLIDE_S)
    odometry, distance = world.odometry(0), world.distance(0)
    assert elevators.ride(NODE, SECOND) == NODE
    assert elevators.floor == SECOND
    assert deep(world, SECOND) == pytest.approx(CABIN_DEPTH_MM / 2)
    assert (world.odometry(0), world.distance(0)) == (odometry, distance)
    elevators.open(NODE)
    wait(world, elevators, SLIDE_S)
    world.command(0, -300.0, 0.0)
    wait(world, elevators, 8.0)
    assert deep(world, SECOND) < -900.0
    other = cabin_of(BUILDING.map_named(SECOND), NODE)
    assert math.cos(math.radians(world.true_pose(0).heading_deg - other.heading_deg)) == pytest.approx(1.0)


def test_shut_doors_stop_a_robot() -> None:
    world, elevators = staged()
    world.command(0, 300.0, 0.0)
    wait(world, elevators, 5.0)
    assert deep(world) == pytest.approx(-IDEAL.radius_mm, abs=0.5)
    assert world.bumper(0).front


def test_doors_do_not_close_on_a_robot() -> None:
    world, elevators = driven_in()
    world.place(0, (*CABIN.point_at(0.0, 100.0), CABIN.heading_deg))
    elevators.close(NODE)
    wait(world, elevators, 3 * SLIDE_S)
    assert elevators.opening(NODE) == 1.0
    assert world.bumps(0) == 0


@pytest.mark.parametrize(
    ("node", "floor", "problem"),
    [
        (NODE, "attic", "does not lead to `attic`"),
        (NODE, THIRD, "does not lead to `msu_engineering_3`"),
        (NODE, SECOND, "robot 0 is not in the cabin: -900 mm behind its doors"),
        ("350L", SECOND, "has no elevator at `350L`; it has acs.elev.L, old.elev.L"),
    ],
)
def test_rides_that_cannot_be_are_refused(node: str, floor: str, problem: str) -> None:
    world, elevators = staged()
    before = world.true_pose(0), world.sonar(0).tolist()
    with pytest.raises(ValueError, match=problem):
        elevators.ride(node, floor)
    assert elevators.floor == THIRD
    assert (world.true_pose(0), world.sonar(0).tolist()) == before


def test_nobody_rides_with_open_doors() -> None:
    _, elevators = driven_in()
    with pytest.raises(ValueError, match="are open; close them before the ride"):
        elevators.ride(NODE, SECOND)


def test_every_floor_has_a_scenery() -> None:
    world, _ = staged()
    with pytest.raises(ValueError, match="floors without scenery: msu_engineering_2"):
        Elevators(world, BUILDING, {THIRD: FLOORS[THIRD]}, THIRD)


def test_an_elevator_that_leads_nowhere_still_opens() -> None:
    cabin = cabin_of(LOOP, "liftL")
    alone = load_building(MAPS / "loop.stickrep")
    world = World(
        walls=draw(Hazards.none(), LOOP, 1),
        poses=[(*cabin.point_at(0.0, -900.0), cabin.heading_deg)],
        config=IDEAL,
    )
    elevators = Elevators(world, alone, {"loop": draw(Hazards.none(), LOOP, 1)}, "loop")
    elevators.open("liftL")
    wait(world, elevators, SLIDE_S)
    assert world.sonar(0)[12] == pytest.approx(900.0 - RING.ring_mm + CABIN_DEPTH_MM)


def test_a_plant_lets_the_doors_slide() -> None:
    world, elevators = staged()
    clock = VirtualClock()
    plant = Plant(world, clock, step_callbacks=(elevators.advance,))
    elevators.open(NODE)
    clock.now_ns = int(SLIDE_S * 0.5e9)
    plant.catch_up()
    assert elevators.opening(NODE) == pytest.approx(0.5)
