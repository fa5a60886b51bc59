"""Scenes: walls and what is on them, in the order that the renderer wants."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from colony.nav.maps.signs import SIGN_HEIGHT_MM, markers_of, plates_of
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.stickrep.reader import load_map, read_map
from colony.nav.maps.walls import walls_of
from colony.sim.cameras import textures
from colony.sim.cameras.atlas import AtlasPicture, posters
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.scene import scene_of
from colony.sim.cameras.surfaces import CEILING_MM, PEOPLE, WallPanel, lighting_of, scene
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.hazards.scenery import CeilingLight
from colony.text.source import Source
from tests.buildings import LOOP, MSU
from tests.paths import MAPS
from tests.sim.robots import FRONT_CAMERA

HEADER = """stickrep 1
map      room
unit     inch
lights   incremental
closure  2
start    60 60 0

ring outline 0 0 0

"""

NARROW = (
    HEADER
    + """-270  A    W  0  90  plaster
 180  1L   D  0  20  wood, room 1
 180  1R   W  0  10  plaster
-270  B    W  0  50  plaster
 180  liftL E 0  15  steel
 180  liftR W 0  55  plaster
-270  C    W  0  120
-270  D    W  0  120
"""
)
"""A room with a door and an elevator that are too narrow for anything."""


def room_of(remark: str) -> Map:
    """A square room; the remark is on one of its walls."""
    rows = [f"-270  {node}  W  0  120  {remark if node == 'A' else 'plaster'}" for node in "ABCD"]
    return read_map(Source("room.stickrep", HEADER + "\n".join(rows) + "\n"))


def test_panels_lie_by_their_walls_in_the_order_given() -> None:
    walls = [[0.0, 0.0, 1000.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 500.0]]
    panels = [
        WallPanel(2, 0.0, 500.0, 0.0, 100.0, 0.1),
        WallPanel(0, 0.0, 1000.0, 0.0, 100.0, 0.2),
        WallPanel(1, 0.0, 1.0, 0.0, 1.0, 0.9),
        WallPanel(2, 100.0, 200.0, 0.0, 100.0, 0.3),
    ]
    made = scene(walls, panels, ceiling_mm=3000)
    assert len(made.walls) == 2  # what has no length is not seen
    assert made.first_panel.tolist() == [0, 1, 3]
    assert made.panels[:, 4].tolist() == [0.2, 0.1, 0.3]
    assert made.ceiling == 3000.0


def test_a_scene_may_be_empty() -> None:
    assert scene([]).first_panel.tolist() == [0]


def test_doors_of_a_map_have_a_leaf_in_a_frame() -> None:
    made, walls = scene_of(LOOP), walls_of(LOOP)
    assert len(made.walls) == len(walls.kinds)
    door = walls.kinds.index(EdgeKind.DOOR)
    frame, leaf = made.panels[made.first_panel[door] : made.first_panel[door + 1]]
    length = float(np.hypot(*(walls.segments[door, 2:] - walls.segments[door, :2])))
    assert frame[:2] == pytest.approx([0.0, length])
    assert leaf[:2] == pytest.approx([60.0, length - 60.0])
    assert leaf[3] < frame[3] < made.ceiling
    plain = walls.kinds.index(EdgeKind.WALL)
    assert made.first_panel[plain + 1] - made.first_panel[plain] == 1


# --- what walls are made of, and what hangs there --------------------------------------------------


@pytest.mark.parametrize(
    ("remark", "cover"),
    [
        ("painted brick, the west end", textures.painted_brick),
        ("brick", textures.bare_brick),
        ("glass brick", textures.glass_brick),
        ("Glass-Block wall", textures.glass_brick),
        ("glass", textures.glass),
        ("window, the south end", textures.window),
        ("marble", textures.tile),
        ("plaster", textures.plaster),
        ("velvet; ???", textures.plaster),
        ("", textures.plaster),
    ],
)
def test_a_remark_says_what_a_wall_is_made_of(remark: str, cover: Callable[[float], AtlasPicture]) -> None:
    made = scene_of(room_of(remark))
    number = int(made.materials[0])
    expected = cover(CEILING_MM)
    wide, high = expected.shades.shape[1], expected.shades.shape[0]
    assert made.atlas.pictures[number, 1:3].tolist() == [wide, high]
    first_panel = int(made.atlas.pictures[number, 0])
    column = np.diff(made.atlas.sums[first_panel + high + 1 : first_panel + 2 * (high + 1)])
    assert column == pytest.approx(expected.shades[:, 0])


def test_an_atlas_has_no_covers_but_those_of_its_floor() -> None:
    plaster, both = (len(scene_of(room_of(remark)).atlas.pictures) for remark in ("plaster", "brick"))
    furniture = len(posters()) + 3  # a fire extinguisher, the sign above it, the walls of rooms
    assert plaster == PEOPLE + 1 + furniture
    assert both == PEOPLE + 2 + furniture


def test_every_wall_of_every_map_has_a_cover() -> None:
    for path in sorted(MAPS.glob("*.stickrep")):
        made = scene_of(load_map(path))
        assert (made.materials >= PEOPLE).all(), path.name


def test_plates_and_markers_hang_where_the_signs_are() -> None:
    made = scene_of(MSU)
    for sign in (*plates_of(MSU), *markers_of(MSU)):
        rows = made.wall_pictures[made.first_wall_picture[sign.edge] : made.first_wall_picture[sign.edge + 1]]
        [row] = [row for row in rows if row[0] == pytest.approx(sign.start_mm)]
        assert row[1] == pytest.approx(sign.end_mm)
        assert (row[2] + row[3]) / 2 == pytest.approx(SIGN_HEIGHT_MM)
        high = made.atlas.pictures[int(row[4]), 2] * made.atlas.pictures[int(row[4]), 4]
        assert high == pytest.approx(row[3] - row[2])


def test_doors_that_are_too_narrow_have_nothing_on_them() -> None:
    narrow = read_map(Source("narrow.stickrep", NARROW))
    assert markers_of(narrow) == ()
    made = scene_of(narrow, draw(Hazards(), narrow, 1))
    assert len(made.first_wall_picture) == len(made.walls) + 1
    camera = Camera(made, FRONT_CAMERA, robot_radius_mm=400.0)
    x, y, _ = narrow.start
    assert all(camera.image(np.array([[x, y, h]]), 0).std() > 0.0 for h in (0.0, 90.0, 180.0, 270.0))


def test_it_is_lighter_under_a_light_and_darker_where_one_is_out() -> None:
    lamp = CeilingLight(x_mm=5000.0, y_mm=5000.0, heading_deg=0.0)
    bounds = (0.0, 0.0, 20_000.0, 10_000.0)
    one, out = (lighting_of(bounds, [light]) for light in (lamp, replace(lamp, brightness=0.0)))
    assert one.levels.shape == (41, 21)
    assert one.levels[10, 10] == one.levels.max() > 1.2 * out.levels[10, 10]
    assert one.levels[40, 10] == out.levels.max() == out.levels.min()
