"""Grids of other projects, as they published or wrote them: published/README.md has their origin.

The cells are held to a reading of their own, which shares nothing with the reader: the YAML by its lines, the
PGM by its bytes, the PNG by OpenCV, and the rules of map_server for one cell after the other. The places are
held to what the world of a grid says of itself in the package that it is from.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from colony.nav.maps.grid.model import GridCell
from colony.nav.maps.grid.reader import load_grid
from tests.cli.conftest import Colony
from tests.cli.conftest import colony as colony
from tests.sampling import sampled

PUBLISHED = Path(__file__).parent / "published"
MAPS = sorted(PUBLISHED.rglob("*.yaml"))
EACH = pytest.mark.parametrize("path", MAPS, ids=lambda path: path.stem)
SOME = pytest.mark.parametrize("path", sampled(MAPS, every=3), ids=lambda path: path.stem)


def keys_of(path: Path) -> dict[str, str]:
    return dict(line.split(": ", 1) for line in path.read_text().splitlines() if line)


def rows_of(image: Path) -> list[list[int]]:
    """The shades of an image, from its top row."""
    if image.suffix == ".png":
        pixels = cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
        assert (pixels.ndim, pixels.dtype) == (2, np.uint8)
        return [[int(shade) for shade in row] for row in pixels.tolist()]
    data = image.read_bytes()
    lines = 4 if data.split(b"\n", 2)[1].startswith(b"#") else 3  # some writers comment the second line
    magic, *_, size, most, pixel_bytes = data.split(b"\n", lines)
    assert (magic, most) == (b"P5", b"255")
    columns, rows = map(int, size.split())
    assert len(pixel_bytes) == columns * rows
    return [list(pixel_bytes[row * columns : (row + 1) * columns]) for row in range(rows)]


def state_of(shade: int, keys: dict[str, str]) -> GridCell:
    assert keys["negate"] == "0"
    occupancy = (255 - shade) / 255
    if occupancy >= float(keys["occupied_thresh"]):
        return GridCell.OCCUPIED
    return GridCell.FREE if occupancy <= float(keys["free_thresh"]) else GridCell.UNKNOWN


def test_there_are_grids_of_four_projects_with_their_licenses() -> None:
    assert (len(MAPS), len({path.parent for path in MAPS})) == (7, 4)
    for path in MAPS:
        assert (path.parent / "LICENSE").stat().st_size > 500
        assert path.with_suffix("").relative_to(PUBLISHED).as_posix() in (PUBLISHED / "README.md").read_text()


@EACH
def test_every_cell_is_what_map_server_says(path: Path) -> None:
    keys, grid = keys_of(path), load_grid(path)
    rows = rows_of(path.parent / keys["image"])
    by_shade = {shade: state_of(shade, keys) for shade in range(256)}
    assert grid.cells.tolist() == [[int(by_shade[shade]) for shade in row] for row in reversed(rows)]


@pytest.mark.thorough
@EACH
def test_every_cell_is_where_map_server_says(path: Path) -> None:
    keys, grid = keys_of(path), load_grid(path)
    rows = rows_of(path.parent / keys["image"])
    side, (x, y, yaw) = float(keys["resolution"]), json.loads(keys["origin"])
    for row in range(0, len(rows), 17):
        for column in range(0, len(rows[0]), 13):
            across, up = (column + 0.5) * side, (len(rows) - row - 0.5) * side
            east = x + math.cos(yaw) * across - math.sin(yaw) * up
            north = y + math.sin(yaw) * across + math.cos(yaw) * up
            expected = state_of(rows[row][column], keys)
            assert grid.state_at(1000.0 * east, 1000.0 * north) is expected, (row, column)


@pytest.mark.parametrize(
    ("name", "free", "occupied"),
    [
        (
            "test_world",
            [(0.75, 0.5), (2.5, 0.5), (2.5, 1.5), (-1.7, 1.6), (2.2, 3.0)],  # rooms and a bend of a hallway
            [(0.85, -0.5), (0.9, 1.1), (-2.45, 2.5), (-2.9, -0.9), (3.4, 0.0)],  # furniture, outside
        ),
        (
            "roscon_2024_workshop_world",
            [(-1.0, 0.0), (1.0, 0.0), (0.0, 0.8), (0.0, -0.8), (-3.5, -1.0)],  # around the dining table
            [(0.0, 0.0), (-4.3, 0.0), (0.0, 3.2)],
        ),
    ],
)  # fmt: skip
def test_places_are_those_of_the_world(
    name: str, free: list[tuple[float, float]], occupied: list[tuple[float, float]]
) -> None:
    """Places in meters, from the description of the world: where a robot can stand, and where it cannot."""
    grid = load_grid(PUBLISHED / "pyrobosim" / f"{name}.yaml")
    for places, state in ((free, GridCell.FREE), (occupied, GridCell.OCCUPIED)):
        for x, y in places:
            assert grid.state_at(1000.0 * x, 1000.0 * y) is state, (x, y)


@SOME
def test_they_are_summarized_and_drawn(path: Path, colony: Colony, tmp_path: Path) -> None:
    code, out, err = colony("map", path, "-o", "drawn.png", "--format", "json")
    assert (code, err) == (0, "")
    rows = rows_of(path.parent / keys_of(path)["image"])
    summary = json.loads(out)
    assert summary["cells"] == [len(rows[0]), len(rows)]
    assert (tmp_path / "drawn.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
@pytest.mark.parametrize(
    ("robot", "name"),
    [
        ("omni", "pyrobosim/roscon_2024_workshop_world"),
        ("omni", "mrpt/basic_map"),
        ("amr", "nav2/depot"),
        ("amr", "f1tenth/stata_basement"),
    ],
)
def test_a_robot_drives_in_them(robot: str, name: str, colony: Colony) -> None:
    where = ("--map", PUBLISHED / f"{name}.yaml", "--no-picture", "--duration", "20", "--format", "json")
    assert json.loads(colony.output("run", "wander", "--robot", robot, *where))["distance_mm"] > 1000.0
