from __future__ import annotations

from pathlib import Path

import pytest

from colony.nav.maps.stickrep.geometry import corners, in_free_space
from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.view.sheet import Box, place_names
from tests.paths import MAPS

MSU = load_map(MAPS / "msu_engineering_3.stickrep")
SCALE = 6_500.0 / 72.0


def test_every_door_and_elevator_of_the_big_map_is_named() -> None:
    names = place_names(MSU, SCALE)
    doors = [name.text for name in names if name.rank == "door"]
    assert len(doors) == MSU.count(EdgeKind.DOOR)
    assert {"381", "NE.men", "303.second", "340.cmptr.room", "A342", "A314"} <= set(doors)
    lifts = [name.text for name in names if name.rank == "elevator"]
    assert lifts == ["acs.elev \u2195 msu_engineering_2", "old.elev \u2195 msu_engineering_2"]


@pytest.mark.parametrize("path", sorted(MAPS.glob("*.stickrep")), ids=lambda path: path.stem)
def test_names_touch_neither_each_other_nor_walls_and_stand_behind_them(path: Path) -> None:
    drawn = load_map(path)
    names = place_names(drawn, 60.0)
    boxes = [name.box for name in names]
    assert not any(a.touches(b) for i, a in enumerate(boxes) for b in boxes[:i])
    for x0, y0, x1, y1 in walls_of(drawn).segments:
        wall = Box(min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1))
        assert not any(wall.touches(box) for box in boxes)  # walls of these maps run along the axes
    outlines = tuple(corners(ring) for ring in drawn.rings)
    assert not any(in_free_space(outlines, *name.center) for name in names)


def test_names_are_turned_where_they_would_not_fit_beside_each_other() -> None:
    def upright(mm_per_point: float) -> dict[str, bool]:
        return {name.text: name.upright for name in place_names(MSU, mm_per_point)}

    assert not upright(90.0)["A332"]
    assert upright(140.0)["A332"]
    assert not upright(140.0)["324"]


def test_what_has_no_room_is_left_out_corners_first() -> None:
    near = place_names(MSU, 20.0)
    far = place_names(MSU, 300.0)
    count = {rank: sum(name.rank == rank for name in far) for rank in ("elevator", "door", "corner")}
    assert len(far) < len(near)
    assert count["elevator"] == 2
    assert 0 < count["door"] < MSU.count(EdgeKind.DOOR)
