"""An office as SLAM would draw it; `python -m tests.nav.maps.grid.office` writes it into maps/.

Rows of rooms along corridors, with doors that stand open, desks, round tables and chairs. Walls are rough, as
the noise of a scanner leaves them, some cells are occupied by mistake, and what no beam reached is unknown.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tests.paths import MAPS

FREE, UNKNOWN, OCCUPIED = 254, 205, 0
CELL_M = 0.05
ROOM, DEPTH, CORRIDOR, WALL, DOOR, MARGIN = 90, 100, 50, 2, 20, 14

Shades = NDArray[np.uint8]
Draws = np.random.Generator


def drawn_office(columns: int, rows: int, seed: int) -> Shades:
    """The shades of an office in an image of this size; the top row is the first."""
    draws = np.random.default_rng(seed)
    image = np.full((rows, columns), UNKNOWN, dtype=np.uint8)
    inside = image[MARGIN:-MARGIN, MARGIN:-MARGIN]
    _box(inside, OCCUPIED, FREE)
    top = WALL
    while top + DEPTH <= inside.shape[0]:
        _rooms(inside[top - WALL : top + DEPTH], draws, door_at_top=False)
        top += DEPTH + CORRIDOR
        if top + DEPTH <= inside.shape[0]:
            _rooms(inside[top - WALL : top + DEPTH], draws, door_at_top=True)
            top += DEPTH
    return _as_scanned(image, draws)


def _box(area: Shades, border: int, content: int) -> None:
    area[:] = border
    area[WALL:-WALL, WALL:-WALL] = content


def _rooms(row: Shades, draws: Draws, *, door_at_top: bool) -> None:
    """Draw rooms side by side, with a passage between two rows of them at the end."""
    for left in range(0, row.shape[1] - ROOM - CORRIDOR, ROOM):
        room = row[:, left : left + ROOM + WALL]
        _box(room, OCCUPIED, FREE)
        door = int(draws.integers(8, ROOM - DOOR - 8))
        wall = room[:WALL] if door_at_top else room[-WALL:]
        wall[:, door : door + DOOR] = FREE
        _furnish(room[25:-25, 8:-8], draws)


def _furnish(area: Shades, draws: Draws) -> None:
    for _ in range(int(draws.integers(1, 3))):
        y, x = (int(draws.integers(0, side - 32)) for side in area.shape)
        desk = area[y : y + 16, x : x + 32]
        if (desk == FREE).all():
            _box(desk, OCCUPIED, UNKNOWN)
    y, x = (int(draws.integers(12, side - 12)) for side in area.shape)
    across, up = np.meshgrid(np.arange(area.shape[1]), np.arange(area.shape[0]))
    distance = np.hypot(across - x, up - y)
    if (area[distance < 14] == FREE).all():
        area[distance < 10] = UNKNOWN
        area[(distance >= 8.5) & (distance < 10)] = OCCUPIED
    for _ in range(int(draws.integers(2, 6))):
        y, x = (int(draws.integers(0, side - 9)) for side in area.shape)
        if (area[y : y + 9, x : x + 9] == FREE).all():
            for dy, dx in ((0, 0), (0, 8), (8, 0), (8, 8)):  # the legs of a chair
                area[y + dy, x + dx] = OCCUPIED


def _as_scanned(image: Shades, draws: Draws) -> Shades:
    near = np.zeros(image.shape, dtype=np.bool_)
    is_wall = image == OCCUPIED
    near[1:] |= is_wall[:-1]
    near[:-1] |= is_wall[1:]
    near[:, 1:] |= is_wall[:, :-1]
    near[:, :-1] |= is_wall[:, 1:]
    chance = draws.random(image.shape)
    is_free = image == FREE
    image[is_free & near & (chance < 0.06)] = OCCUPIED
    image[is_free & (chance > 0.9997)] = OCCUPIED
    image[is_free & (chance > 0.9985) & (chance < 0.999)] = UNKNOWN
    return image


YAML = """\
# An office of 25 m by 20 m, as SLAM would draw it: docs/grids.md.
image: office.png
mode: trinary
resolution: 0.05
origin: [-3.0, -14.4, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
DOCKS = "docks: [[3.0, -0.75, -1.5708], [10.5, -13.25, -1.5708]]\n"


def write_office(folder: Path) -> None:
    """Write the office that comes with the project."""
    image = drawn_office(532, 430, seed=13)
    Image.fromarray(image).save(folder / "office.png", optimize=True)
    (folder / "office.yaml").write_text(YAML + DOCKS, encoding="utf-8")


if __name__ == "__main__":
    write_office(MAPS)
