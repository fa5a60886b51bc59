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
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from colony.nav.maps.signs import (
    CHARACTER_HEIGHT_MM,
    MARKER_BITS,
    MARKER_WIDTH_MM,
    PLATE_HEIGHT_MM,
    PLATE_WIDTH_MM,
    STRIPE_HEIGHT_MM,
)
from colony.sim.compiled import Floats, Floats2, called, inlined

if TYPE_CHECKING:
    from PIL.Image import Image


OFFSET, COLUMNS, ROWS, ACROSS, DOWN, OPACITY, WRAPS = range(7)
"""Columns of `Atlas.pictures`: start of the table, size in texels, mm per texel across and down, start of the
table of opacities (negative if opaque), and 1 if the picture repeats horizontally, else 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AtlasPicture:
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


def atlas_of(pictures: Sequence[AtlasPicture]) -> Atlas:
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


# --- lettering ----------------------------------------------------------------------------------------
#
# Drawings of signs: door plates, elevator markers, and the text of posters.
#
# The font is DejaVu Sans Bold, which matplotlib includes.

TEXEL_MM = 2.0

_BLACK, _WHITE = 0.05, 0.90
_MARGIN_MM = 14.0  # on either side of a plate's characters, which are squeezed if there are many
_SUPERSAMPLING = 4  # factor by which letters are drawn larger before they are reduced


def font_file() -> Path:
    """Return the file of DejaVu Sans Bold.

    Raises:
        FileNotFoundError: matplotlib is not installed, or has no such font.
    """
    spec = find_spec("matplotlib")
    if spec is None or spec.origin is None:
        raise FileNotFoundError("matplotlib, which provides the font of door plates, is not installed")
    path = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans-Bold.ttf"
    if not path.is_file():
        raise FileNotFoundError(f"{path}: font not found; expected it to be installed with matplotlib")
    return path


@lru_cache(maxsize=256)
def plate(text: str) -> AtlasPicture:
    """Draw the plate of a door: white characters on black."""
    height, width = round(PLATE_HEIGHT_MM / TEXEL_MM), round(PLATE_WIDTH_MM / TEXEL_MM)
    ink = np.zeros((height, width))
    _write(ink, text, height_mm=CHARACTER_HEIGHT_MM, center=(width / 2, height / 2), max_width=width)
    return AtlasPicture(
        shades=_BLACK + (_WHITE - _BLACK) * ink, width_mm=PLATE_WIDTH_MM, height_mm=PLATE_HEIGHT_MM
    )


@lru_cache(maxsize=16)
def marker(code: int) -> AtlasPicture:
    """Draw the marker of an elevator: bits between separators, the first bit leftmost."""
    stripes = [_BLACK]
    for bit in reversed(range(MARKER_BITS)):
        stripes += [_BLACK if code >> bit & 1 else _WHITE, _BLACK]
    return AtlasPicture(shades=np.array([stripes]), width_mm=MARKER_WIDTH_MM, height_mm=STRIPE_HEIGHT_MM)


def write_lines(ink: Floats2, lines: tuple[str, ...], *, height_mm: float) -> None:
    """Write lines of this character height, spread evenly over a picture with texels of `TEXEL_MM`."""
    height, width = ink.shape
    for number, line in enumerate(lines):
        center = (width / 2, height * (number + 0.5) / len(lines))
        _write(ink, line, height_mm=height_mm, center=center, max_width=width)


def _write(ink: Floats2, text: str, *, height_mm: float, center: tuple[float, float], max_width: int) -> None:
    """Write a text with capitals `height_mm` high into `ink`, the covered fraction of each texel."""
    if not text:
        return
    from PIL.Image import Resampling

    lettering = _draw_letters(text, round(_SUPERSAMPLING * height_mm / TEXEL_MM))
    height = round(height_mm / TEXEL_MM * lettering.height / round(_SUPERSAMPLING * height_mm / TEXEL_MM))
    max_texels = max(1, max_width - round(2 * _MARGIN_MM / TEXEL_MM))
    width = min(round(lettering.width / _SUPERSAMPLING), max_texels)
    reduced = lettering.resize((width, max(height, 1)), Resampling.BOX)
    top, left = round(center[1] - reduced.height / 2), round(center[0] - reduced.width / 2)
    rows = slice(max(top, 0), min(top + reduced.height, ink.shape[0]))
    columns = slice(max(left, 0), min(left + reduced.width, ink.shape[1]))
    coverage = np.asarray(reduced, dtype=np.float64) / 255.0
    ink[rows, columns] = coverage[
        rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
    ]


def _draw_letters(text: str, capital_height: int) -> Image:
    """Draw a text, cropped to its ink; capitals are `capital` pixels high."""
    from PIL import Image, ImageDraw, ImageFont

    trial = ImageFont.truetype(str(font_file()), 1000)
    _, top, _, bottom = trial.getbbox("H")
    font = ImageFont.truetype(str(font_file()), max(1, round(1000 * capital_height / (bottom - top))))
    left, top, right, bottom = (round(side) for side in font.getbbox(text))
    canvas = Image.new("L", (max(right - left, 1), max(bottom - top, 1)))
    ImageDraw.Draw(canvas).text((-left, -top), text, fill=255, font=font)
    return canvas


# --- posters ------------------------------------------------------------------------------------------
#
# Posters and notices in the corridors of a university.
#
# A finder of door plates may mistake the black ones for plates: black with pale writing, of the size of a
# plate or slightly larger (thesis Table 6.3 has four false plates of this kind).

SIGN_MM = (150.0, 200.0)
"""Width and height of the sign above a fire extinguisher."""

_BLACK_POSTERS = (
    ((420.0, 150.0), ("ROBOTICS", "LAB"), 0.75),
    ((340.0, 130.0), ("SPARTY",), 0.60),
    ((300.0, 180.0), ("IEEE", "MEETING", "7 PM"), 0.70),
    ((480.0, 220.0), ("SENIOR DESIGN", "DAY 1994"), 0.80),
    ((360.0, 120.0), ("NO FOOD",), 0.85),
)
"""Size in mm, lines of text, and shade of the writing."""

_COLORED_POSTERS = (
    ((420.0, 594.0), 0.32, 0.90),
    ((594.0, 841.0), 0.55, 0.15),
    ((594.0, 420.0), 0.70, 0.20),
    ((841.0, 594.0), 0.24, 0.80),
)
"""Size in mm, and the shades of the paper and of the print."""

_NOTICES = 2
_NOTICE_MM = (216.0, 279.0)
POSTERS_MM = (
    *(size for size, _, _ in _BLACK_POSTERS),
    *(size for size, _, _ in _COLORED_POSTERS),
    *(_NOTICE_MM,) * _NOTICES,
)
"""Width and height of each kind of poster."""

BLACK_KINDS = tuple(range(len(_BLACK_POSTERS)))
OTHER_KINDS = tuple(range(len(_BLACK_POSTERS), len(_BLACK_POSTERS) + len(_COLORED_POSTERS) + _NOTICES))
"""The numbers of the black posters, and of all others."""


@lru_cache(maxsize=1)
def posters() -> tuple[AtlasPicture, ...]:
    """Return all kinds of posters, by number."""
    black = [_black_poster(size, lines, shade) for size, lines, shade in _BLACK_POSTERS]
    colored = [
        _colored_poster(size, paper, ink, seed) for seed, (size, paper, ink) in enumerate(_COLORED_POSTERS)
    ]
    return (*black, *colored, *(_notice(seed) for seed in range(_NOTICES)))


def _sheet(size: tuple[float, float], shade: float) -> Floats2:
    return np.full((round(size[1] / TEXEL_MM), round(size[0] / TEXEL_MM)), shade)


def _picture(shades: Floats2, size: tuple[float, float]) -> AtlasPicture:
    return AtlasPicture(shades=np.clip(shades, 0.0, 1.0), width_mm=size[0], height_mm=size[1])


def _black_poster(size: tuple[float, float], lines: tuple[str, ...], shade: float) -> AtlasPicture:
    sheet = _sheet(size, 0.06)
    ink = np.zeros_like(sheet)
    write_lines(ink, lines, height_mm=min(70.0, 0.55 * size[1] / len(lines)))
    return _picture(sheet + (shade - sheet) * ink, size)


def _colored_poster(size: tuple[float, float], paper: float, print_: float, seed: int) -> AtlasPicture:
    """Draw a heading, a picture and a few lines of text too small to be read."""
    rng = np.random.default_rng(100 + seed)
    sheet = _sheet(size, paper)
    high, wide = sheet.shape
    head = np.zeros((high // 5, wide))
    write_lines(head, (("CAREER FAIR", "JAZZ", "COLLOQUIUM", "CALL FOR PAPERS")[seed],), height_mm=55.0)
    sheet[: high // 5] += (print_ - sheet[: high // 5]) * head
    rows, columns = slice(high // 4, high * 3 // 5), slice(wide // 8, wide * 7 // 8)
    patches = rng.random((3, 4))
    shape = sheet[rows, columns].shape
    sheet[rows, columns] = np.kron(patches, np.ones((-(-shape[0] // 3), -(-shape[1] // 4))))[
        : shape[0], : shape[1]
    ]
    _lines_of_text(sheet, range(high * 13 // 20, high * 19 // 20, 12), print_, rng)
    return _picture(sheet, size)


def _notice(seed: int) -> AtlasPicture:
    """Draw a white sheet of letter paper with lines of text."""
    rng = np.random.default_rng(200 + seed)
    sheet = _sheet(_NOTICE_MM, 0.93)
    _lines_of_text(sheet, range(12, sheet.shape[0] - 8, 8), 0.25, rng)
    return _picture(sheet, _NOTICE_MM)


def _lines_of_text(sheet: Floats2, rows: range, ink: float, rng: np.random.Generator) -> None:
    """Draw lines of words, each a little bar of gray; in place."""
    wide = sheet.shape[1]
    for row in rows:
        column = end = wide // 8
        stop = wide - wide // 8 - int(rng.integers(0, wide // 4))
        while end < stop:
            end = min(column + int(rng.integers(6, 18)), stop)
            sheet[row : row + 3, column:end] += 0.7 * (ink - sheet[row : row + 3, column:end])
            column = end + 3


@lru_cache(maxsize=1)
def extinguisher_sign() -> AtlasPicture:
    """Draw FIRE, pale on red."""
    sheet = _sheet(SIGN_MM, 0.30)
    ink = np.zeros_like(sheet)
    write_lines(ink, ("FIRE", "", "EXT"), height_mm=34.0)
    high, wide = sheet.shape
    ink[high * 2 // 5 : high * 3 // 5, wide * 2 // 5 : wide * 3 // 5] = 1.0
    return _picture(sheet + (0.88 - sheet) * ink, SIGN_MM)
