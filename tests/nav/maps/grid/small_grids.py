"""Small grids in files and in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from colony.nav.maps.grid.model import Grid, GridCell

KEYS = {
    "image": "map.png",
    "resolution": "0.05",
    "origin": "[-1.0, -2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
STATES = {".": GridCell.FREE, "#": GridCell.OCCUPIED, "?": GridCell.UNKNOWN}


def yaml_of(**changed: str | None) -> str:
    """The text of a YAML file; a key that is None is left out."""
    return "".join(f"{key}: {value}\n" for key, value in (KEYS | changed).items() if value is not None)


def written(folder: Path, shades: NDArray[np.uint8] | Image.Image | bytes, **changed: str | None) -> Path:
    """Write a grid into files, its image in the format of the name `image`."""
    image = folder / ((KEYS | changed)["image"] or "map.png")
    if isinstance(shades, bytes):
        image.write_bytes(shades)
    else:
        (shades if isinstance(shades, Image.Image) else Image.fromarray(shades)).save(image)
    path = folder / "map.yaml"
    path.write_text(yaml_of(**changed))
    return path


def grid_of(
    drawing: str, *, cell_mm: float = 50.0, x_mm: float = 0.0, y_mm: float = 0.0, yaw_deg: float = 0.0
) -> Grid:
    """A grid as it is drawn: `.` free, `#` occupied, `?` unknown; the first line is the highest row."""
    rows = [[STATES[letter] for letter in line] for line in drawing.split()]
    return Grid(
        name="drawn",
        image="drawn.png",
        cells=np.array(rows[::-1], dtype=np.uint8),
        cell_mm=cell_mm,
        x_mm=x_mm,
        y_mm=y_mm,
        yaw_deg=yaw_deg,
    )
