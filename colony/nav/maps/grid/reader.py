"""A reader of occupancy grids, as slam_toolbox and nav2's map_saver write them.

What is free, occupied and unknown is decided as nav2's map_server does. A shade is taken for an occupancy
from 0 to 1: darker is more, unless the map says `negate`. In the mode `raw` shades are percents: those above
100 are unknown. A cell is occupied from `occupied_thresh`, free up to `free_thresh`, and unknown between
them; a cell that is not opaque is unknown, but in the mode `raw`. Arithmetic is in single precision, as
there, so that cells on a threshold fall on the same side.

Codes of errors: M001 cannot be read, M002 not text, M023 too large, M032 not the YAML of a map, M033 unknown
key, M034 malformed value, M035 key missing or twice, M036 image.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.grid.image import Shades, load_image
from colony.nav.maps.grid.keys import GridKeys, Mode, read_keys
from colony.nav.maps.grid.model import Cell, Grid
from colony.nav.maps.source import load_source
from colony.nav.maps.stickrep.model import Pose
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Span
from colony.text.wording import listed

EAST_DEG = 270.0
"""The heading of a robot that looks along x, with a yaw of 0."""

MAX_YAML_BYTES = 1 << 16

_UNKNOWN_SHADE = 205  # map_saver writes it for unknown cells
_MOST_SHADES = 6  # that are listed
_THRESHOLDS = {
    Cell.FREE: ("free_thresh",),
    Cell.OCCUPIED: ("occupied_thresh",),
    Cell.UNKNOWN: ("free_thresh", "occupied_thresh"),
}


def load_grid(path: str | os.PathLike[str]) -> Grid:
    """Read the grid at `path`, and its image.

    Raises:
        DiagnosticError: a file cannot be read, or is not valid; with all errors found, each with its
            location.
    """
    keys = read_keys(load_source(path, MAX_YAML_BYTES))
    image = os.path.join(os.path.dirname(path), keys.image)
    shades = load_image(image, keys.image_span)
    cells = cells_of(shades, keys)
    x, y, yaw = keys.origin
    grid = Grid(
        name=Path(path).stem,
        image=image,
        cells=cells,
        cell_mm=keys.cell_m * 1000.0,
        x_mm=x * 1000.0,
        y_mm=y * 1000.0,
        yaw_deg=math.degrees(yaw),
        docks=tuple(_pose(*dock) for dock in keys.docks),
        remarks=_remarks(shades, keys, cells),
    )
    if keys.docks_span is not None:
        _check_docks(grid, keys.docks_span)
    return grid


def _pose(x_m: float, y_m: float, yaw: float) -> Pose:
    """Return a pose of ROS as one of this project."""
    return Pose(x_m * 1000.0, y_m * 1000.0, (EAST_DEG + math.degrees(yaw)) % 360.0)


def _check_docks(grid: Grid, span: Span) -> None:
    for dock in grid.docks:
        state = grid.state_at(dock.x_mm, dock.y_mm)
        if state is not Cell.FREE:
            at = f"({dock.x_mm / 1000.0:g}, {dock.y_mm / 1000.0:g})"
            message = f"`docks`: the dock at {at} is in a cell that is {state.name.lower()}"
            raise DiagnosticError([error("M034", span, message, "a robot stands there: give a free place")])


def cells_of(shades: Shades, keys: GridKeys) -> NDArray[np.uint8]:
    """Return the states of the cells, (rows, columns) of `Cell`, the lowest row first; read-only."""
    cells = _states(keys)[shades.shade]
    if shades.is_opaque is not None and keys.mode is not Mode.RAW:
        cells[~shades.is_opaque] = Cell.UNKNOWN
    cells = np.ascontiguousarray(cells[::-1])
    cells.flags.writeable = False
    return cells


def _states(keys: GridKeys) -> NDArray[np.uint8]:
    """Return the state of a cell of each shade, from 0 to 255."""
    levels = np.arange(256)
    if keys.mode is Mode.RAW:
        occupancy = levels.astype(np.float32) / np.float32(100.0)
    else:
        occupancy = levels.astype(np.float32) / np.float32(255.0)
        occupancy = occupancy if keys.negate else np.float32(1.0) - occupancy
    states = np.full(256, Cell.UNKNOWN, dtype=np.uint8)
    states[occupancy >= np.float32(keys.occupied_thresh)] = Cell.OCCUPIED
    states[occupancy <= np.float32(keys.free_thresh)] = Cell.FREE
    if keys.mode is Mode.RAW:
        states[levels > 100] = Cell.UNKNOWN
    return states


def _remarks(shades: Shades, keys: GridKeys, cells: NDArray[np.uint8]) -> tuple[str, ...]:
    """Return why a state is that of no cell; of unknown cells only if the image seems to have some."""
    is_opaque = shades.is_opaque if keys.mode is not Mode.RAW else None
    found = np.unique(shades.shade if is_opaque is None else shades.shade[is_opaque]).tolist()
    if not found:
        return ("no cell is free or occupied: all of the image is transparent, which is unknown",)
    states, trinary = _states(keys), _states(replace(keys, mode=Mode.TRINARY))
    remarks = []
    for state, thresholds in _THRESHOLDS.items():
        is_expected = state is not Cell.UNKNOWN or (keys.mode is not Mode.RAW and _UNKNOWN_SHADE in found)
        if (cells == state).any() or not is_expected:
            continue
        name = state.name.lower()
        given = listed([f"{key} {getattr(keys, key):g}" for key in thresholds])
        text = f"no cell is {name}: the image has {_shades_text(found)}; "
        text += f"in the mode {keys.mode.value}, {_range_text(states == state)} as {name} ({given})"
        if is_opaque is not None and not is_opaque.all():
            text += f"; {100.0 * np.mean(~is_opaque):.3g} % of the image are transparent, which is unknown"
        if keys.mode is Mode.RAW and state in trinary[found]:
            text += "; `mode: trinary` would give some"
        remarks.append(text)
    return tuple(remarks)


def _shades_text(shades: list[int]) -> str:
    """Return the shades of an image as text; the ends of many."""
    if len(shades) > _MOST_SHADES:
        return f"{len(shades)} shades from {shades[0]} to {shades[-1]}"
    return ("the shade " if len(shades) == 1 else "the shades ") + listed([str(shade) for shade in shades])


def _range_text(counts: NDArray[np.bool_]) -> str:
    """Return the shades that count as something, as text with its verb."""
    shades = np.nonzero(counts)[0]
    if len(shades) == 0:
        return "no shade counts"
    return f"shade {shades[0]} counts" if len(shades) == 1 else f"shades {shades[0]} to {shades[-1]} count"
