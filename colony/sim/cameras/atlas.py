"""Pictures on walls, stored as summed-area tables, which give the mean of any rectangle in constant time.

A pixel of a camera sees a patch of a wall whose size depends on the distance and the viewing angle. Its gray
level is the mean over that patch, which a summed-area table gives exactly (Crow 1984) for any size: there is
no aliasing, and motion of less than a pixel is visible.

A picture has the size that it has in the building; its origin is the upper left corner.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from colony.sim.compiled import Floats, Floats2, called, inlined

OFFSET, COLUMNS, ROWS, ACROSS, DOWN, OPACITY, WRAPS = range(7)
"""Columns of `Atlas.pictures`: start of the table, size in texels, mm per texel across and down, start of the
table of opacities (negative if opaque), and 1 if the picture repeats horizontally, else 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A picture of `width_mm` by `height_mm`.

    Attributes:
        shades: (rows, columns), from 0 (black) to 1.
        opacity: (rows, columns), the opacity of each texel; None if all are opaque.
        wraps: True if the picture repeats horizontally.
    """

    shades: Floats2
    width_mm: float
    height_mm: float
    opacity: Floats2 | None = None
    wraps: bool = False


class Atlas(NamedTuple):
    """Pictures in the renderer's form.

    `sums` has the summed-area tables of all pictures in sequence, each (columns + 1, rows + 1); `pictures`,
    (n, 7), has their offsets and sizes.
    """

    sums: Floats
    pictures: Floats2


def atlas_of(pictures: Sequence[Picture]) -> Atlas:
    """Return an atlas of pictures, numbered as given."""
    tables: list[Floats] = []
    entries: list[tuple[float, ...]] = []
    table_start = 0
    for picture in pictures:
        rows, columns = picture.shades.shape
        layers = [picture.shades if picture.opacity is None else picture.shades * picture.opacity]
        layers += [] if picture.opacity is None else [picture.opacity]
        offsets = []
        for layer in layers:
            table = np.zeros((columns + 1, rows + 1))
            table[1:, 1:] = layer.T.cumsum(axis=0).cumsum(axis=1)
            tables.append(table.ravel())
            offsets.append(table_start)
            table_start += table.size
        across, down = picture.width_mm / columns, picture.height_mm / rows
        opacity_offset = float(offsets[1]) if len(offsets) > 1 else -1.0
        entries.append((offsets[0], columns, rows, across, down, opacity_offset, float(picture.wraps)))
    return Atlas(
        sums=np.concatenate([np.zeros(0), *tables]),
        pictures=np.array(entries, dtype=np.float64).reshape(-1, 7),
    )


@inlined
def _interpolate(
    sums: Floats, start: int, rows: int, column_fraction: float, row: int, row_fraction: float
) -> float:
    """Interpolate a summed-area table between its columns and rows.

    `start` is the offset of the left column; the fractions are those toward the next column and row.
    """
    index = start + row
    left: float = sums[index] + row_fraction * (sums[index + 1] - sums[index])
    index += rows + 1
    right: float = sums[index] + row_fraction * (sums[index + 1] - sums[index])
    return left + column_fraction * (right - left)


@inlined
def _strip(
    sums: Floats, offset: int, columns: int, rows: int, left: float, right: float, laps: float, down: float
) -> float:
    """Return the sum over the columns from `left` to `right`, from the top down to row `down`.

    `laps` is the number of whole repetitions of the picture in between.
    """
    row = min(int(down), rows - 1)
    rest = down - row
    first, last = min(int(left), columns - 1), min(int(right), columns - 1)
    total = _interpolate(sums, offset + last * (rows + 1), rows, right - last, row, rest)
    total -= _interpolate(sums, offset + first * (rows + 1), rows, left - first, row, rest)
    if laps != 0.0:
        total += laps * _interpolate(sums, offset + (columns - 1) * (rows + 1), rows, 1.0, row, rest)
    return total


@called
def paint_picture(
    out: Floats, atlas: Atlas, picture: int, left: float, right: float, width: float,
    first: int, last: int, above: float, step: float, clip_top: float, clip_bottom: float, gain: float,
) -> None:  # fmt: skip
    """Paint the part of a picture that a column of pixels sees.

    Args:
        out: the column, from its top.
        atlas: the pictures.
        picture: number of the picture.
        left: start of the visible part, in mm from the picture's left edge; within the picture unless it
            repeats.
        right: end of the visible part, in mm from the picture's left edge.
        width: width in mm of the wall that the column covers, which includes `left` to `right`.
        first: first row that sees the picture.
        last: row after the last one that sees it.
        above: distance in mm of the upper edge of row 0 below the top of the picture.
        step: mm per row.
        clip_top: start of the visible part, in mm below the top of the picture.
        clip_bottom: end of the visible part, in mm below the top of the picture.
        gain: factor from shades to gray levels.
    """
    entry = atlas.pictures[picture]
    columns, rows, offset, opacity_offset = (
        int(entry[COLUMNS]),
        int(entry[ROWS]),
        int(entry[OFFSET]),
        int(entry[OPACITY]),
    )
    start, end, laps = left / entry[ACROSS], right / entry[ACROSS], 0.0
    if entry[WRAPS] > 0.0:
        start_lap, end_lap = math.floor(start / columns), math.floor(end / columns)
        start, end, laps = start - start_lap * columns, end - end_lap * columns, end_lap - start_lap
    start, end = min(max(start, 0.0), columns + 0.0), min(max(end, 0.0), columns + 0.0)
    area = width / entry[ACROSS] * step / entry[DOWN]
    width_fraction = min((right - left) / width, 1.0)
    down = min(max(above + first * step, clip_top), clip_bottom)
    table_row = min(max(down / entry[DOWN], 0.0), rows + 0.0)
    before = _strip(atlas.sums, offset, columns, rows, start, end, laps, table_row)
    hidden_before = 0.0
    if opacity_offset >= 0:
        hidden_before = _strip(atlas.sums, opacity_offset, columns, rows, start, end, laps, table_row)
    for row in range(first, last):
        lower = min(max(above + (row + 1) * step, clip_top), clip_bottom)
        table_row = min(max(lower / entry[DOWN], 0.0), rows + 0.0)
        after = _strip(atlas.sums, offset, columns, rows, start, end, laps, table_row)
        hidden = width_fraction * (lower - down) / step
        if opacity_offset >= 0:
            hidden_after = _strip(atlas.sums, opacity_offset, columns, rows, start, end, laps, table_row)
            hidden = (hidden_after - hidden_before) / area
            hidden_before = hidden_after
        out[row] += gain * (after - before) / area - hidden * out[row]
        before, down = after, lower
