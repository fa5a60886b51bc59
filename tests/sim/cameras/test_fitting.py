"""Scenes among the walls of a world: doors that stand open, and those of elevators that slide."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from colony.nav.maps.building import load_building
from colony.nav.maps.signs import markers_of, plates_of
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import walls_of
from colony.sim.cameras.atlas import BLACK_KINDS, POSTERS_MM, posters
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.fitting import scene_with_walls
from colony.sim.cameras.optics import PINHOLE
from colony.sim.cameras.scene import scene_of
from colony.sim.cameras.surfaces import EXTINGUISHER_MM
from colony.sim.compiled import Bytes2
from colony.sim.hazards.hazards import Hazard, Hazards, draw
from colony.sim.hazards.scenery import Scenery
from colony.sim.world.elevators import SLIDE_S, Elevators, cabin_of
from colony.sim.world.world import World
from tests.buildings import HALLWAY, LOOP, MSU
from tests.paths import MAPS
from tests.sim.robots import FRONT_CAMERA, IDEAL

NODE = "acs.elev.L"
CABIN = cabin_of(MSU, NODE)
[MARKER] = [marker for marker in markers_of(MSU) if marker.node == NODE]
CALM = draw(Hazards.none(), MSU, 1)
SHARP = replace(FRONT_CAMERA, optics=PINHOLE)
FOCAL = 120.0 / math.tan(math.radians(30.0))


def before_the_doors() -> tuple[World, Elevators, Camera]:
    building = load_building(MAPS / "msu_engineering_3.stickrep")
    floors = {floor.name: draw(Hazards.none(), floor, 1) for floor in building.maps}
    world = World(
        walls=floors[MSU.name], poses=[(*CABIN.point_at(0.0, -1500.0), CABIN.heading_deg)], config=IDEAL
    )
    elevators = Elevators(world, building, floors, MSU.name)
    return world, elevators, Camera(scene_of(MSU, floors[MSU.name]), SHARP, robot_radius_mm=400.0)


def white(image: Bytes2) -> list[int]:
    """Where the white stripes of a marker begin and end in the row of its middle, between the jambs."""
    half = int(CABIN.width_mm / 2 * FOCAL / 1500.0)
    row = image[60, 120 - half : 120 + half].astype(int)
    bright = row > 0.85 * row.max()
    return (np.flatnonzero(np.diff(bright.astype(int))) + 1 + 120 - half).tolist()


def test_a_shut_elevator_shows_its_marker_where_projection_says() -> None:
    world, _, camera = before_the_doors()
    step = FOCAL / 1500.0 * 88.9
    edges = white(camera.see(world, 0, 0))
    assert edges == pytest.approx([120 + step * k for k in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5)], abs=1.0)


def test_each_leaf_takes_along_its_half_of_the_marker() -> None:
    world, elevators, camera = before_the_doors()
    elevators.open(NODE)
    for _ in range(10):
        world.advance(0.05)
        elevators.advance(0.05)
    slid = elevators.opening(NODE) * CABIN.width_mm / 2 * FOCAL / 1500.0
    assert slid > 10.0
    step = FOCAL / 1500.0 * 88.9
    edges = white(camera.see(world, 0, 0))
    shut = (-2.5, -1.5, -0.5, 0.0, 0.0, 0.5, 1.5, 2.5)
    sides = [120 + step * k + math.copysign(slid, place - 3.5) for place, k in enumerate(shut)]
    assert edges == pytest.approx(sides, abs=1.5)


def test_open_doors_show_the_cabin_and_no_marker() -> None:
    world, elevators, camera = before_the_doors()
    shut = camera.see(world, 0, 0)
    elevators.open(NODE)
    for _ in range(round(SLIDE_S / 0.05) + 1):
        world.advance(0.05)
        elevators.advance(0.05)
    inside = camera.see(world, 0, 0)[50:70, 90:150]
    assert inside.max() - inside.min() < 12  # a plain wall, 1.8 m behind the doors
    elevators.close(NODE)
    for _ in range(round(SLIDE_S / 0.05) + 1):
        world.advance(0.05)
        elevators.advance(0.05)
    closed = camera.see(world, 0, 0)
    assert white(closed) == white(shut)


def test_plates_stay_beside_doors_that_stand_open() -> None:
    every = draw(Hazards(on=frozenset({Hazard.DOORS}), open_door=1.0), MSU, 1)
    open_door_segments = {door.edge for door in every.doors}
    made = scene_of(MSU, every)
    wall_pictures = [
        wall
        for wall in range(made.map_wall_count)
        if made.first_wall_picture[wall + 1] > made.first_wall_picture[wall]
    ]
    assert {plate.edge for plate in plates_of(MSU)} <= set(wall_pictures)
    shut = {
        edge for edge, kind in enumerate(walls_of(MSU).kinds) if kind is EdgeKind.DOOR
    } - open_door_segments
    assert {wall for wall in range(made.map_wall_count) if not made.present[wall]} == open_door_segments
    assert all(made.present[edge] for edge in shut)
    rooms = made.materials[made.map_wall_count :] == made.room_material
    assert rooms.sum() >= 3 * len(open_door_segments)
    leaves = np.diff(made.first_panel)[made.map_wall_count :].sum()
    assert len(open_door_segments) <= leaves <= 2 * len(open_door_segments)


@pytest.mark.parametrize("seed", range(3))
def test_a_plate_beside_an_open_door_looks_as_beside_a_shut_one(seed: int) -> None:
    every = draw(Hazards(on=frozenset({Hazard.DOORS}), open_door=1.0), MSU, seed)
    camera, calm = (Camera(scene_of(MSU, scenery), SHARP, robot_radius_mm=400.0) for scenery in (every, CALM))
    for plate in plates_of(MSU)[::9]:
        angle = math.radians(plate.heading_deg)
        at = np.array([[plate.center.x + 1000 * math.sin(angle), plate.center.y - 1000 * math.cos(angle),
                        plate.heading_deg]])  # fmt: skip
        one, other = (eye.image(at, 0)[45:75, 84:156] for eye in (camera, calm))
        assert (one == other).all(), plate.door


def test_fitting_again_gives_the_same_and_what_was_shut_comes_back() -> None:
    every = draw(Hazards(on=frozenset({Hazard.DOORS}), open_door=1.0), LOOP, 1)
    shut, open_door_segments = scene_of(LOOP), scene_of(LOOP, every)
    again = scene_with_walls(open_door_segments, every.walls)
    for name, one, other in zip(open_door_segments._fields, open_door_segments, again, strict=True):
        if isinstance(one, np.ndarray):
            assert np.array_equal(one, other), name
    back = scene_with_walls(open_door_segments, shut.walls)
    assert back.present.all()
    assert np.array_equal(back.panels, shut.panels)
    assert np.array_equal(back.first_panel, shut.first_panel)
    assert np.array_equal(back.walls, shut.walls)


# --- posters and fire extinguishers ---


RUNS = 60
DRAWN = [draw(Hazards(), MSU, seed) for seed in range(RUNS)]
WALLS = walls_of(MSU)
LENGTHS = np.hypot(*(WALLS.segments[:, 2:] - WALLS.segments[:, :2]).T)


def spans(scenery: Scenery) -> dict[int, list[tuple[float, float]]]:
    """What hangs on each edge, from where to where."""
    found: dict[int, list[tuple[float, float]]] = {}
    for poster in scenery.posters:
        end = poster.start_mm + POSTERS_MM[poster.kind][0]
        found.setdefault(poster.edge, []).append((poster.start_mm, end))
    for one in scenery.extinguishers:
        half = EXTINGUISHER_MM[0] / 2
        found.setdefault(one.edge, []).append((one.along_mm - half, one.along_mm + half))
    return found


def test_black_posters_hang_on_walls_and_doors_at_their_rates() -> None:
    black = [poster for scenery in DRAWN for poster in scenery.posters if poster.kind in BLACK_KINDS]
    doors = [poster for poster in black if WALLS.kinds[poster.edge] is EdgeKind.DOOR]
    shut = sum(kind is EdgeKind.DOOR for kind in WALLS.kinds)
    expected = RUNS * shut * 0.02
    assert abs(len(doors) - expected) < 4.0 * math.sqrt(expected)
    room = LENGTHS[[kind is EdgeKind.WALL for kind in WALLS.kinds]].sum()
    expected = RUNS * room / 80_000.0
    on_walls = len(black) - len(doors)
    assert on_walls <= expected + 4.0 * math.sqrt(expected)
    assert on_walls >= 0.75 * expected  # short walls have no room for some


def test_other_posters_and_extinguishers_at_theirs() -> None:
    room = LENGTHS[[kind is EdgeKind.WALL for kind in WALLS.kinds]].sum()
    others = sum(poster.kind not in BLACK_KINDS for scenery in DRAWN for poster in scenery.posters)
    extinguishers = sum(len(scenery.extinguishers) for scenery in DRAWN)
    for found, spacing in ((others, 15_000.0), (extinguishers, 25_000.0)):
        expected = RUNS * room / spacing
        assert 0.7 * expected < found < expected + 4.0 * math.sqrt(expected), (found, expected)


@pytest.mark.parametrize("floor", [MSU, LOOP, HALLWAY], ids=lambda floor: floor.name)
def test_nothing_hangs_over_a_plate_or_over_the_end_of_a_wall(floor: Map) -> None:
    walls = walls_of(floor)
    lengths = np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T)
    crowded = Hazards(poster_spacing_mm=1500.0, black_poster_spacing_mm=4000.0, poster_on_door=0.5)
    for seed in range(4):
        for edge, wall_pictures in spans(draw(crowded, floor, seed)).items():
            taken = [(p.start_mm, p.end_mm) for p in plates_of(floor) if p.edge == edge]
            ordered = sorted([*wall_pictures, *taken])
            assert ordered[0][0] >= 0.0
            assert ordered[-1][1] <= lengths[edge]
            assert all(one[1] < other[0] for one, other in pairwise(ordered))
            assert walls.kinds[edge] is not EdgeKind.ELEVATOR
            assert "window" not in walls.attributes[edge]


def test_posters_are_as_large_as_they_are_said_to_be() -> None:
    assert [(one.width_mm, one.height_mm) for one in posters()] == list(POSTERS_MM)
    for kind in BLACK_KINDS:
        assert np.median(posters()[kind].shades) < 0.1
        assert posters()[kind].shades.max() > 0.5
