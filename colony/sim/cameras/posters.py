"""Posters and notices in the corridors of a university.

A finder of door plates may mistake the black ones for plates: black with pale writing, of the size of a plate
or slightly larger (thesis Table 6.3 has four false plates of this kind).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from colony.sim.cameras.atlas import Picture
from colony.sim.cameras.lettering import TEXEL_MM, write_lines
from colony.sim.compiled import Floats2

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
def posters() -> tuple[Picture, ...]:
    """Return all kinds of posters, by number."""
    black = [_black_poster(size, lines, shade) for size, lines, shade in _BLACK_POSTERS]
    colored = [
        _colored_poster(size, paper, ink, seed) for seed, (size, paper, ink) in enumerate(_COLORED_POSTERS)
    ]
    return (*black, *colored, *(_notice(seed) for seed in range(_NOTICES)))


def _sheet(size: tuple[float, float], shade: float) -> Floats2:
    return np.full((round(size[1] / TEXEL_MM), round(size[0] / TEXEL_MM)), shade)


def _picture(shades: Floats2, size: tuple[float, float]) -> Picture:
    return Picture(shades=np.clip(shades, 0.0, 1.0), width_mm=size[0], height_mm=size[1])


def _black_poster(size: tuple[float, float], lines: tuple[str, ...], shade: float) -> Picture:
    sheet = _sheet(size, 0.06)
    ink = np.zeros_like(sheet)
    write_lines(ink, lines, height_mm=min(70.0, 0.55 * size[1] / len(lines)))
    return _picture(sheet + (shade - sheet) * ink, size)


def _colored_poster(size: tuple[float, float], paper: float, print_: float, seed: int) -> Picture:
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


def _notice(seed: int) -> Picture:
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
def extinguisher_sign() -> Picture:
    """Draw FIRE, pale on red."""
    sheet = _sheet(SIGN_MM, 0.30)
    ink = np.zeros_like(sheet)
    write_lines(ink, ("FIRE", "", "EXT"), height_mm=34.0)
    high, wide = sheet.shape
    ink[high * 2 // 5 : high * 3 // 5, wide * 2 // 5 : wide * 3 // 5] = 1.0
    return _picture(sheet + (0.88 - sheet) * ink, SIGN_MM)
