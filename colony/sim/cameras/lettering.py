"""Drawings of signs: door plates, elevator markers, and the text of posters.

The font is DejaVu Sans Bold, which matplotlib includes.
"""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from colony.nav.maps.signs import (
    CHARACTER_HEIGHT_MM,
    MARKER_BITS,
    MARKER_WIDTH_MM,
    PLATE_HEIGHT_MM,
    PLATE_WIDTH_MM,
    STRIPE_HEIGHT_MM,
)
from colony.sim.cameras.atlas import Picture
from colony.sim.compiled import Floats2

if TYPE_CHECKING:  # PIL is imported only by processes that draw letters
    from PIL.Image import Image

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
def plate(text: str) -> Picture:
    """Draw the plate of a door: white characters on black."""
    height, width = round(PLATE_HEIGHT_MM / TEXEL_MM), round(PLATE_WIDTH_MM / TEXEL_MM)
    ink = np.zeros((height, width))
    _write(ink, text, height_mm=CHARACTER_HEIGHT_MM, center=(width / 2, height / 2), max_width=width)
    return Picture(
        shades=_BLACK + (_WHITE - _BLACK) * ink, width_mm=PLATE_WIDTH_MM, height_mm=PLATE_HEIGHT_MM
    )


@lru_cache(maxsize=16)
def marker(code: int) -> Picture:
    """Draw the marker of an elevator: bits between separators, the first bit leftmost."""
    stripes = [_BLACK]
    for bit in reversed(range(MARKER_BITS)):
        stripes += [_BLACK if code >> bit & 1 else _WHITE, _BLACK]
    return Picture(shades=np.array([stripes]), width_mm=MARKER_WIDTH_MM, height_mm=STRIPE_HEIGHT_MM)


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
