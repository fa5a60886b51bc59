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

import io
import math
import os
import re
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.files import read_file, reason
from colony.nav.maps.grid.keys import GridKeys, OccupancyMode, read_keys
from colony.nav.maps.grid.model import Grid, GridCell
from colony.nav.maps.source import load_source
from colony.nav.maps.stickrep.model import Pose
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Span
from colony.text.wording import listed, printable

if TYPE_CHECKING:
    from PIL.Image import Image


# --- image --------------------------------------------------------------------------------------------
#
# The image of an occupancy grid, as shades and opacities of its cells.

MAX_IMAGE_BYTES = 64 << 20
MAX_CELLS = 16_000_000
FORMATS = {"PPM": "PGM", "PNG": "PNG", "BMP": "BMP"}
"""The formats of images, by their names in Pillow: those that map_saver recommends."""

_OPAQUE = 255

_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_HEADER = re.compile(rb"(?:(P4)|(P[56]))%b(\d{1,9})%b(\d{1,9})(?(2)%b(\d{1,5}))" % (_GAP, _GAP, _GAP))
_REMARK = re.compile(rb"[ \t]*#[^\r\n]*")
_MAX_HEADER_BYTES = 1 << 16


class Shades(NamedTuple):
    """An image: rows from the top, shades from 0, black, to 255, white; True for cells that are opaque."""

    shade: NDArray[np.uint8]
    is_opaque: NDArray[np.bool_] | None


def load_image(path: str | os.PathLike[str], named: Span) -> Shades:
    """Load the image at `path`; `named` is the place that names it.

    Images of 16 bits are rounded to 8, and colors are replaced by their luma.

    Raises:
        DiagnosticError: the file cannot be read, is no image, is damaged or too large.
    """
    shown = printable(os.fspath(path))
    try:
        data = read_file(path, MAX_IMAGE_BYTES)
    except OSError as failure:
        raise _failure(named, f"cannot read the image `{shown}`: {reason(failure)}") from None
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the limit here is lower
            image = Image.open(io.BytesIO(_plain_header(data)), formats=list(FORMATS))
    except UnidentifiedImageError:
        raise _unknown(named, shown) from None
    except Image.DecompressionBombError:
        raise _too_large(named, "too many cells") from None
    except Exception:  # decoders raise exceptions of many kinds, with texts for programmers
        raise _damaged(named, shown, "its header is malformed or cut off") from None
    columns, rows = image.size
    if columns * rows > MAX_CELLS:
        raise _too_large(named, f"{columns} x {rows} cells")
    if image.mode == "F":  # a PFM, which Pillow takes for a kind of PGM
        raise _unknown(named, shown)
    try:
        return _shades(image)
    except Exception:  # as above
        raise _damaged(named, shown, "its cells are malformed or cut off") from None


def _plain_header(data: bytes) -> bytes:
    """Return a binary PBM, PGM or PPM with line feeds and no comments in its header; other data unchanged.

    By the format, and for Pillow, one byte ends the header. Programs end it with CR LF or a comment, too: the
    longest end is taken after which there are enough bytes for the cells.
    """
    header = _HEADER.match(data, 0, _MAX_HEADER_BYTES)
    if header is None:
        return data
    bitmap, other, columns, rows, maximum = header.groups()
    magic = bitmap or other
    bits = 1 if magic == b"P4" else (8 if int(maximum) < 256 else 16) * (3 if magic == b"P6" else 1)
    size = int(rows) * ((int(columns) * bits + 7) // 8)
    ends = _ends(data[: header.end() + _MAX_HEADER_BYTES], header.end())
    start = max((end for end in ends if len(data) - end >= size), default=None)
    if start is None:
        return data
    words = [magic, columns, rows, *([] if maximum is None else [maximum])]
    return b"\n".join([*words, data[start:]])


def _ends(data: bytes, at: int) -> Iterator[int]:
    """Yield the places where a header can end whose last word ends at `at`."""
    waiting = [at]
    while waiting:
        at = waiting.pop()
        remark = _REMARK.match(data, at)
        at = at if remark is None else remark.end()
        for length in {2 if data.startswith(b"\r\n", at) else 1, 1}:
            if data[at : at + 1].isspace():
                yield at + length
                waiting += [at + length] if data.startswith(b"#", at + length) else []


def _shades(image: Image) -> Shades:
    is_opaque = None
    if image.has_transparency_data:
        colors = image.convert("RGBA")
        is_opaque = np.asarray(colors.getchannel("A")) == _OPAQUE
        image = colors.convert("RGB")
    if image.mode.startswith("I"):
        return Shades(np.rint(np.asarray(image).astype(np.float64) / 257.0).astype(np.uint8), is_opaque)
    return Shades(np.asarray(image.convert("L")), is_opaque)


def _unknown(named: Span, shown: str) -> DiagnosticError:
    return _failure(named, f"`{shown}` is no image of a map; expected {' or '.join(FORMATS.values())}")


def _damaged(named: Span, shown: str, what: str) -> DiagnosticError:
    return _failure(named, f"the image `{shown}` is damaged: {what}")


def _too_large(named: Span, found: str) -> DiagnosticError:
    message = f"the image has {found}; expected at most {MAX_CELLS:,} of them"
    return DiagnosticError([error("M023", named, message)])


def _failure(named: Span, message: str) -> DiagnosticError:
    hint = "the path counts from the folder of the map" if "No such file" in message else None
    return DiagnosticError([error("M036", named, message, hint)])


# --- reader -------------------------------------------------------------------------------------------

EAST_DEG = 270.0
"""The heading of a robot that looks along x, with a yaw of 0."""

MAX_YAML_BYTES = 1 << 16

_UNKNOWN_SHADE = 205  # map_saver writes it for unknown cells
_MOST_SHADES = 6  # that are listed
_THRESHOLDS = {
    GridCell.FREE: ("free_thresh",),
    GridCell.OCCUPIED: ("occupied_thresh",),
    GridCell.UNKNOWN: ("free_thresh", "occupied_thresh"),
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
        if state is not GridCell.FREE:
            at = f"({dock.x_mm / 1000.0:g}, {dock.y_mm / 1000.0:g})"
            message = f"`docks`: the dock at {at} is in a cell that is {state.name.lower()}"
            raise DiagnosticError([error("M034", span, message, "a robot stands there: give a free place")])


def cells_of(shades: Shades, keys: GridKeys) -> NDArray[np.uint8]:
    """Return the states of the cells, (rows, columns) of `GridCell`, the lowest row first; read-only."""
    cells = _states(keys)[shades.shade]
    if shades.is_opaque is not None and keys.mode is not OccupancyMode.RAW:
        cells[~shades.is_opaque] = GridCell.UNKNOWN
    cells = np.ascontiguousarray(cells[::-1])
    cells.flags.writeable = False
    return cells


def _states(keys: GridKeys) -> NDArray[np.uint8]:
    """Return the state of a cell of each shade, from 0 to 255."""
    levels = np.arange(256)
    if keys.mode is OccupancyMode.RAW:
        occupancy = levels.astype(np.float32) / np.float32(100.0)
    else:
        occupancy = levels.astype(np.float32) / np.float32(255.0)
        occupancy = occupancy if keys.negate else np.float32(1.0) - occupancy
    states = np.full(256, GridCell.UNKNOWN, dtype=np.uint8)
    states[occupancy >= np.float32(keys.occupied_thresh)] = GridCell.OCCUPIED
    states[occupancy <= np.float32(keys.free_thresh)] = GridCell.FREE
    if keys.mode is OccupancyMode.RAW:
        states[levels > 100] = GridCell.UNKNOWN
    return states


def _remarks(shades: Shades, keys: GridKeys, cells: NDArray[np.uint8]) -> tuple[str, ...]:
    """Return why a state is that of no cell; of unknown cells only if the image seems to have some."""
    is_opaque = shades.is_opaque if keys.mode is not OccupancyMode.RAW else None
    found = np.unique(shades.shade if is_opaque is None else shades.shade[is_opaque]).tolist()
    if not found:
        return ("no cell is free or occupied: all of the image is transparent, which is unknown",)
    states, trinary = _states(keys), _states(replace(keys, mode=OccupancyMode.TRINARY))
    remarks = []
    for state, thresholds in _THRESHOLDS.items():
        is_expected = state is not GridCell.UNKNOWN or (
            keys.mode is not OccupancyMode.RAW and _UNKNOWN_SHADE in found
        )
        if (cells == state).any() or not is_expected:
            continue
        name = state.name.lower()
        given = listed([f"{key} {getattr(keys, key):g}" for key in thresholds])
        text = f"no cell is {name}: the image has {_shades_text(found)}; "
        text += f"in the mode {keys.mode.value}, {_range_text(states == state)} as {name} ({given})"
        if is_opaque is not None and not is_opaque.all():
            text += f"; {100.0 * np.mean(~is_opaque):.3g} % of the image are transparent, which is unknown"
        if keys.mode is OccupancyMode.RAW and state in trinary[found]:
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
