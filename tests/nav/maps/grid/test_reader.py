"""Grids in files: cells as map_server decides them, and images that cannot be used."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from colony.nav.maps.grid.model import GridCell
from colony.nav.maps.grid.reader import MAX_CELLS, load_grid
from colony.nav.maps.stickrep.model import Pose
from colony.nav.maps.world_map import load_world, world_of_grid
from colony.sim.hazards.hazards import Hazards, scenery_of
from colony.text.diagnostics import headline
from tests.diagnostics import problems_of
from tests.nav.maps.grid.small_grids import written

F, O, U = GridCell.FREE, GridCell.OCCUPIED, GridCell.UNKNOWN  # noqa: E741
SHADES = np.array([[254, 205, 0], [255, 207, 100]], dtype=np.uint8)
CELLS = [[F, F, U], [F, U, O]]
"""Of `SHADES`: of 100 the occupancy is 155/255 = 0.61, of 205 it is 0.1961, and of 207 it is 0.188."""


def occupancy_of(cell: NDArray[np.uint8] | int, *, negate: bool) -> float:
    shade = float(np.float32(cell) / np.float32(255))
    return shade if negate else float(np.float32(1) - np.float32(shade))


def test_the_lowest_row_is_the_last_of_the_image(tmp_path: Path) -> None:
    grid = load_grid(written(tmp_path, SHADES))
    assert grid.cells.tolist() == CELLS
    assert (grid.name, grid.cell_mm, grid.x_mm, grid.y_mm, grid.yaw_deg) == (
        "map",
        50.0,
        -1000.0,
        -2000.0,
        0.0,
    )
    assert grid.image == str(tmp_path / "map.png")


def test_every_shade_is_what_map_server_says(tmp_path: Path) -> None:
    shades = np.arange(256, dtype=np.uint8).reshape(1, -1)
    for negate in (False, True):
        for free, occupied in ((0.196, 0.65), (0.25, 0.65), (0.0, 1.0), (0.2, 0.6)):
            grid = load_grid(
                written(
                    tmp_path,
                    shades,
                    negate=str(int(negate)),
                    free_thresh=str(free),
                    occupied_thresh=str(occupied),
                )
            )
            for shade, cell in enumerate(grid.cells[0].tolist()):
                p = occupancy_of(shade, negate=negate)
                expected = F if p <= np.float32(free) else O if p >= np.float32(occupied) else U
                assert cell == expected, (shade, negate, free, occupied)


def test_raw_shades_are_percents_whatever_negate_says(tmp_path: Path) -> None:
    shades = np.array([[0, 19, 20, 64, 65, 100, 101, 255]], dtype=np.uint8)
    for negate in ("0", "1"):
        grid = load_grid(written(tmp_path, shades, mode="raw", negate=negate))
        assert grid.cells.tolist() == [[F, F, U, U, O, O, U, U]]


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_a_cell_that_is_not_opaque_is_unknown(tmp_path: Path, mode: str) -> None:
    alpha = np.array([[255, 255, 254], [0, 255, 255]], dtype=np.uint8)
    image = Image.fromarray(np.dstack([SHADES, alpha]), "LA")
    assert load_grid(written(tmp_path, image, mode=mode)).cells.tolist() == [[U, F, U], [F, U, U]]
    assert load_grid(written(tmp_path, image, mode="raw")).cells.tolist() == [[U, U, O], [U, U, F]]


@pytest.mark.parametrize("name", ["map.pgm", "map.png", "map.bmp"])
def test_formats(tmp_path: Path, name: str) -> None:
    assert load_grid(written(tmp_path, SHADES, image=name)).cells.tolist() == CELLS


@pytest.mark.parametrize(
    "data",
    [
        b"P2\n# CREATOR: map_saver\n3 2\n255\n254 205 0\n255 207 100\n",
        b"P5\n# CREATOR: map_generator.cpp 0.050 m/pix\n3 2\n255\n" + SHADES.tobytes(),
        b"P5 3 2 65535\n" + (SHADES.astype(">u2") * 257).tobytes(),
    ],
)
def test_portable_gray_maps_as_others_write_them(tmp_path: Path, data: bytes) -> None:
    assert load_grid(written(tmp_path, data, image="map.pgm")).cells.tolist() == CELLS


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("comments", ["", "first", "last"])
@pytest.mark.parametrize("first", [254, 10, 13, 35])  # 10, 13 and 35 are LF, CR and `#`
@pytest.mark.parametrize("after", [b"", b"\n"])
def test_headers_of_portable_maps_end_lines_as_they_like(
    tmp_path: Path, end: bytes, comments: str, first: int, after: bytes
) -> None:
    shades = np.array([[first, 205, 0], [255, 207, 10]], dtype=np.uint8)
    expected = [[F, F, O], [O if first != 254 else F, U, O]]
    remark = b"# 7 8 9" + end
    dark = np.packbits(shades < 128, axis=1)
    rows = {
        b"P5": shades.tobytes(),
        b"P6": np.repeat(shades[..., None], 3, axis=2).tobytes(),
        b"P2": end.join(b" ".join(b"%d" % shade for shade in row) for row in shades),
        b"P4": dark.tobytes(),
    }
    for magic, data in rows.items():
        words = [
            magic,
            *([remark] if comments == "first" else []),
            b"3 2",
            *([] if magic == b"P4" else [b"255"]),
        ]
        header = b"".join(word if word is remark else word + end for word in words)
        header += remark if comments == "last" else b""
        if end == b"\r" and data[:1] == b"\n" and after:
            continue  # CR LF, as far as anybody can tell
        cells = load_grid(written(tmp_path, header + data + after, image="map.pgm")).cells.tolist()
        assert cells == (np.where(dark_cells(shades), O, F).tolist() if magic == b"P4" else expected)


def dark_cells(shades: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return shades[::-1] < 128


@pytest.mark.parametrize(
    ("shades", "changed", "remarks"),
    [
        ([0, 205, 254], {}, []),
        ([0, 254], {}, []),
        (
            [205, 254],
            {},
            [
                "no cell is occupied: the image has the shades 205 and 254; in the mode trinary, "
                "shades 0 to 89 count as occupied (occupied_thresh 0.65)"
            ],
        ),
        (
            [0, 205, 254],
            {"mode": "raw"},
            [
                "no cell is occupied: the image has the shades 0, 205 and 254; in the mode raw, "
                "shades 65 to 100 count as occupied (occupied_thresh 0.65); `mode: trinary` would give some"
            ],
        ),
        (
            [0, 205, 254],
            {"free_thresh": "0.25"},
            [
                "no cell is unknown: the image has the shades 0, 205 and 254; in the mode "
                "trinary, shades 90 to 191 count as unknown (free_thresh 0.25 and occupied_thresh 0.65)"
            ],
        ),
        (
            [*range(100)],
            {"free_thresh": "0.0", "mode": "scale"},
            [
                "no cell is free: the image has 100 shades from 0 to 99; in the mode scale, "
                "shade 255 counts as free (free_thresh 0)"
            ],
        ),
        (
            [0],
            {"negate": "1"},
            [
                "no cell is occupied: the image has the shade 0; in the mode trinary, "
                "shades 166 to 255 count as occupied (occupied_thresh 0.65)"
            ],
        ),
    ],
)
def test_a_state_without_cells_is_explained(
    tmp_path: Path, shades: list[int], changed: dict[str, str], remarks: list[str]
) -> None:
    grid = load_grid(written(tmp_path, np.array([shades], dtype=np.uint8), **changed))
    assert list(grid.remarks) == remarks


def test_transparency_explains_a_state_without_cells(tmp_path: Path) -> None:
    def remarks(alpha: list[int], **changed: str) -> tuple[str, ...]:
        image = Image.fromarray(np.array([[[0, a] for a in alpha]], dtype=np.uint8), "LA")
        return load_grid(written(tmp_path, image, **changed)).remarks

    assert remarks([255, 0, 0, 0]) == (
        "no cell is free: the image has the shade 0; in the mode trinary, shades 206 to 255 count as free "
        "(free_thresh 0.196); 75 % of the image are transparent, which is unknown",
    )
    assert remarks([0, 254]) == (
        "no cell is free or occupied: all of the image is transparent, which is unknown",
    )
    assert "transparent" not in remarks([0, 0], mode="raw")[0]


def test_colors_and_palettes(tmp_path: Path) -> None:
    gray = Image.fromarray(SHADES)
    for image in (gray.convert("RGB"), gray.convert("RGBA"), gray.convert("P")):
        assert load_grid(written(tmp_path, image)).cells.tolist() == CELLS
    deep = Image.fromarray(SHADES.astype(np.uint16) * 257)
    assert load_grid(written(tmp_path, deep)).cells.tolist() == CELLS


def test_the_yaw_and_where_cells_are(tmp_path: Path) -> None:
    grid = load_grid(written(tmp_path, SHADES, origin="[1.0, 2.0, 1.5707963267948966]"))
    assert grid.to_world(np.array([[0.0, 0.0], [3.0, 2.0]])).tolist() == [[1000.0, 2000.0], [900.0, 2150.0]]
    turned = load_grid(written(tmp_path, SHADES, origin="[1.0, 2.0, -0.3]"))
    cells = np.array([[0.25, 1.5], [2.0, -4.0]])
    assert turned.to_cells(turned.to_world(cells)) == pytest.approx(cells)
    [x, y] = turned.to_world(np.array([1.0, 0.0])).tolist()
    assert (x, y) == pytest.approx((1000.0 + 50.0 * np.cos(0.3), 2000.0 - 50.0 * np.sin(0.3)))


def test_an_image_elsewhere(tmp_path: Path) -> None:
    path = written(tmp_path, SHADES)
    (tmp_path / "folder").mkdir()
    os.rename(tmp_path / "map.png", tmp_path / "folder" / "x.png")
    for image in ("folder/x.png", f"{tmp_path}/folder/x.png"):
        path.write_text(path.read_text().replace("map.png", image))
        assert load_grid(path).cells.tolist() == CELLS


def problem(path: Path) -> str:
    [found] = problems_of(load_grid, path)
    return headline(found).replace(str(path.parent), "FOLDER")


CELLS_DAMAGED = "the image `FOLDER/map.png` is damaged: its cells are malformed or cut off"
HEADER_DAMAGED = "the image `FOLDER/map.png` is damaged: its header is malformed or cut off"


def png(columns: int, rows: int) -> bytes:
    """The begin of a PNG of this size."""
    head = b"IHDR" + struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    begin = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))
    return begin + struct.pack(">I", 9) + b"IDAT" + b"x" * 9 + b"\0\0\0\0"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"P5 3 2 255\n\0\0", CELLS_DAMAGED),
        (b"P2 3 2 255\n1 2 x", CELLS_DAMAGED),
        (b"P5 3 2 99999999\n", HEADER_DAMAGED),
        (b"P5 3", HEADER_DAMAGED),
        (b"", "`FOLDER/map.png` is no image of a map; expected PGM or PNG or BMP"),
        (b"GIF89a\1\0\1\0\0\0\0;", "`FOLDER/map.png` is no image of a map; expected PGM or PNG or BMP"),
        (b"Pf 1 1 -1.0\n\0\0\x80\x3f", "`FOLDER/map.png` is no image of a map; expected PGM or PNG or BMP"),
        (png(3, 2), CELLS_DAMAGED),
    ],
)  # fmt: skip
def test_images_that_cannot_be_used(tmp_path: Path, data: bytes, message: str) -> None:
    assert problem(written(tmp_path, data)) == f"FOLDER/map.yaml:1:8: error[M036]: {message}"


def test_a_path_with_a_line_break_is_shown_on_one_line(tmp_path: Path) -> None:
    path = written(tmp_path, SHADES)
    path.write_text(path.read_text().replace("map.png", '"a\\nb.png"'))
    where = "FOLDER/map.yaml:1:8: error[M036]: cannot read the image `FOLDER/a\\nb.png`: "
    assert problem(path) == where + "No such file or directory"


@pytest.mark.parametrize("data", [b"P5 99999999 99999999 255\n", png(20_000, 20_000), b"P5 4001 4000 255\n"])
def test_images_that_are_too_large(tmp_path: Path, data: bytes) -> None:
    found = problem(written(tmp_path, data))
    assert found.startswith("FOLDER/map.yaml:1:8: error[M023]: the image has ")
    assert found.endswith(f" cells; expected at most {MAX_CELLS:,} of them")


def test_images_that_are_not_there_or_no_files(tmp_path: Path) -> None:
    path = written(tmp_path, SHADES)
    (tmp_path / "map.png").unlink()
    where = "FOLDER/map.yaml:1:8: error[M036]: cannot read the image `FOLDER/map.png`: "
    assert problem(path) == where + "No such file or directory"
    os.mkfifo(tmp_path / "map.png")
    assert problem(path) == where + "it is not a regular file"


def test_a_file_that_is_not_there_or_too_large(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    assert problem(path).startswith("FOLDER/map.yaml:1:1: error[M001]: cannot read the map: No such file")
    path.write_text("#" * 70_000)
    assert problem(path) == "FOLDER/map.yaml:1:1: error[M002]: the file is larger than 64 KiB; expected a map"


def test_docks_are_poses_of_this_project(tmp_path: Path) -> None:
    free = np.full((40, 60), 254, dtype=np.uint8)
    grid = load_grid(written(tmp_path, free, docks="[[0.5, -1.0, 0.0], [-0.5, -1.5, 1.5707963267948966]]"))
    assert grid.docks == (Pose(500.0, -1000.0, 270.0), Pose(-500.0, -1500.0, 0.0))
    world = world_of_grid(grid)
    assert scenery_of(world, Hazards.none(), 1).docks == world.docks == grid.docks


def test_a_dock_that_is_not_in_a_free_cell_is_reported(tmp_path: Path) -> None:
    shades = np.full((40, 60), 254, dtype=np.uint8)
    shades[0] = 0
    where = "FOLDER/map.yaml:7:8: error[M034]: `docks`: the dock at "
    for at, state in (("(0, -0.01)", "occupied"), ("(-2, -1)", "unknown")):
        docks = f"[[0, -1, 0], [{at[1:-1]}, 0]]"
        assert problem(written(tmp_path, shades, docks=docks)).startswith(
            f"{where}{at} is in a cell that is {state}"
        )


@pytest.mark.parametrize("name", ["map.png", "map.PGM"])
def test_the_image_of_a_grid_is_no_map(tmp_path: Path, name: str) -> None:
    image = tmp_path / name
    image.write_bytes(b"P5\n1 1\n255\n\xfe")
    [found] = problems_of(load_world, image)
    assert (found.code, found.hint) == ("M002", "this is an image: give the YAML file of the occupancy grid")
