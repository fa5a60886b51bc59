"""What is drawn or printed on walls, as arrays of levels from 0 to 1 (rows, columns, 3), by pillow.

The fonts are Roboto, Lato and Source Sans Pro, which no reader of plates was trained with.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from colony.nav.maps.signs import CHARACTER_HEIGHT_MM, PLATE_HEIGHT_MM, PLATE_WIDTH_MM

Picture = NDArray[np.float64]
Color = tuple[float, float, float]

FONTS = {
    "Roboto": ("font_roboto", "Roboto-Medium.ttf"),
    "Roboto Bold": ("font_roboto", "Roboto-Bold.ttf"),
    "Lato": ("font_lato", "Lato-Regular.ttf"),
    "Lato Bold": ("font_lato", "Lato-Bold.ttf"),
    "Source Sans Pro": ("font_source_sans_pro", "SourceSansPro-Semibold.ttf"),
    "Source Sans Pro Bold": ("font_source_sans_pro", "SourceSansPro-Bold.ttf"),
}
"""The name of a font: the package that ships it, and its file."""

PIXELS_A_MM = 2.0
_WORDS = ("fall colloquium on robotics and vision room change office hours today seminar moved lost umbrella "
          "thesis defense friday coffee please close door quietly students wanted").split()  # fmt: skip


class Print(NamedTuple):
    """A picture and its size in mm."""

    picture: Picture
    width_mm: float
    height_mm: float


def font_file(name: str) -> Path:
    """Where the file of a font is.

    Raises:
        FileNotFoundError: the package that ships it is not installed.
    """
    package, file = FONTS[name]
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise FileNotFoundError(f"no font `{name}`: install the package {package.replace('_', '-')}")
    return Path(spec.origin).parent / "files" / file


def plate(text: str, font: str, *, black: float, white: float) -> Print:
    """A door plate: white characters in its middle, narrowed where they are too many."""
    width, height = (round(mm * PIXELS_A_MM) for mm in (PLATE_WIDTH_MM, PLATE_HEIGHT_MM))
    face = ImageFont.truetype(
        str(font_file(font)), _size_of_capitals(font, CHARACTER_HEIGHT_MM * PIXELS_A_MM)
    )
    left, top, right, bottom = face.getbbox(text)
    drawn = Image.new("L", (int(right - left) + 2, int(bottom - top)), 0)
    ImageDraw.Draw(drawn).text((1 - left, -top), text, font=face, fill=255)
    widest = round(0.9 * width)
    if drawn.width > widest:
        drawn = drawn.resize((widest, drawn.height), Image.Resampling.LANCZOS)
    sheet = Image.new("L", (width, height), 0)
    sheet.paste(drawn, ((width - drawn.width) // 2, (height - drawn.height) // 2))
    ink = np.asarray(sheet, dtype=np.float64)[:, :, None] / 255.0
    return Print(np.repeat(black + (white - black) * ink, 3, axis=2), PLATE_WIDTH_MM, PLATE_HEIGHT_MM)


def _size_of_capitals(font: str, pixels: float) -> int:
    """The size of a font whose capitals are so high."""
    _, top, _, bottom = ImageFont.truetype(str(font_file(font)), 1000).getbbox("H")
    return round(pixels * 1000.0 / (bottom - top))


def poster(rng: np.random.Generator, *, size_mm: tuple[float, float], paper: Color, ink: Color) -> Print:
    """A sheet with a headline, lines of writing below it, and on high ones a drawing."""
    width, height = (round(mm) for mm in size_mm)
    sheet = Image.new("RGB", (width, height), _rgb(paper))
    draw = ImageDraw.Draw(sheet)
    lines = int(rng.integers(2, 5)) if height < 300 else int(rng.integers(4, 9))
    pitch = 0.9 * height / (lines + 0.5)
    names = list(FONTS)
    for line in range(lines):
        letters = pitch * (0.85 if line == 0 else 0.6)
        face = ImageFont.truetype(
            str(font_file(names[int(rng.integers(len(names)))])), max(8, round(letters))
        )
        words = " ".join(rng.choice(_WORDS, 6))
        while len(words) > 1 and draw.textlength(words, font=face) > 0.88 * width:
            words = words[:-1]
        draw.text((0.06 * width, 0.05 * height + line * pitch), words, font=face, fill=_rgb(ink))
    if height >= 300:
        _sketch(draw, rng, width, height)
    return Print(np.asarray(sheet, dtype=np.float64) / 255.0, *size_mm)


def _sketch(draw: ImageDraw.ImageDraw, rng: np.random.Generator, width: int, height: int) -> None:
    """Some colored shapes on the lower half of a poster."""
    for _ in range(int(rng.integers(1, 4))):
        x0, x1 = sorted(rng.uniform(0.05 * width, 0.95 * width, 2).tolist())
        y0, y1 = sorted(rng.uniform(0.5 * height, 0.95 * height, 2).tolist())
        shape = draw.ellipse if rng.random() < 0.5 else draw.rectangle
        shape((x0, y0, x1, y1), fill=_rgb(rng.uniform(0.1, 0.9, 3).tolist()))


def marker(code: int, bits: int, *, stripe_mm: float, height_mm: float, black: float, white: float) -> Print:
    """A barcode: a black separator, then every bit and a black separator; ones are black, zeros white."""
    stripes = [black]
    for bit in reversed(range(bits)):
        stripes += [black if code >> bit & 1 else white, black]
    row = np.repeat(np.array(stripes), 32)
    return Print(np.broadcast_to(row[None, :, None], (8, row.size, 3)).copy(),
                 len(stripes) * stripe_mm, height_mm)  # fmt: skip


def bricks(rng: np.random.Generator, *, paint: float, mortar: float) -> Print:
    """Painted bricks, 200 by 100 mm with joints, two courses high and four bricks wide; it can be tiled."""
    picture = np.full((200, 800, 3), paint) + rng.normal(0.0, 0.01, (200, 800, 1))
    for course in range(2):
        top = 100 * course
        picture[top : top + 9] = mortar
        for brick in range(4):
            left = (200 * brick + 100 * course) % 800
            picture[top : top + 100, left : left + 9] = mortar
            shade = rng.normal(0.0, 0.02)
            picture[top + 9 : top + 100, left + 9 : min(left + 200, 800)] += shade
    return Print(np.clip(picture, 0.02, 0.98), 800.0, 200.0)


def plaster(rng: np.random.Generator, *, paint: float) -> Print:
    """Rough paint: noise of several sizes; it can be tiled."""
    picture = np.zeros((256, 256))
    for size in (4, 16, 64, 256):
        coarse = rng.normal(0.0, 0.012, (size, size))
        picture += np.kron(coarse, np.ones((256 // size, 256 // size)))
    return Print(np.clip(paint + picture, 0.02, 0.98)[:, :, None].repeat(3, axis=2), 1200.0, 1200.0)


def wood(rng: np.random.Generator, *, tone: Color) -> Print:
    """The leaf of a door, its grain upright."""
    grain = np.cumsum(rng.normal(0.0, 0.02, 300))
    grain -= np.linspace(grain[0], grain[-1], 300)
    rows = np.arange(64)[:, None]
    wavy = grain[(np.arange(300)[None, :] + (6.0 * np.sin(rows / 11.0)).astype(int)) % 300]
    picture = np.array(tone) * (1.0 + wavy[:, :, None]) + rng.normal(0.0, 0.01, (64, 300, 1))
    return Print(np.clip(picture, 0.02, 0.95), 1000.0, 2100.0)


def ceiling_tiles(rng: np.random.Generator, *, paint: float) -> Print:
    """Tiles of 600 mm with seams and small holes, two by two; it can be tiled."""
    picture = np.full((480, 480), paint) + rng.normal(0.0, 0.015, (480, 480))
    picture[rng.integers(0, 480, 900), rng.integers(0, 480, 900)] -= 0.25
    for at in (0, 240):
        picture[at : at + 4] = paint - 0.22
        picture[:, at : at + 4] = paint - 0.22
    return Print(np.clip(picture, 0.02, 0.98)[:, :, None].repeat(3, axis=2), 1200.0, 1200.0)


def glass_bricks(rng: np.random.Generator, *, columns: int, rows: int) -> Picture:
    """How bright each part of a backlit wall of glass bricks is: bright and dark blocks with dark joints."""
    cells = rng.uniform(0.15, 1.0, (rows, columns)) ** 1.5
    ramp = 1.0 - np.hypot(*np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20))) * rng.uniform(
        0.1, 0.5
    )
    picture: Picture = np.kron(cells, np.clip(ramp, 0.0, 1.0)).astype(np.float64)
    for step in range(0, picture.shape[0], 20):
        picture[step : step + 2] = 0.02
    for step in range(0, picture.shape[1], 20):
        picture[:, step : step + 2] = 0.02
    return picture[:, :, None].repeat(3, axis=2)


def _rgb(color: Color | list[float]) -> tuple[int, int, int]:
    red, green, blue = (round(255.0 * min(max(c, 0.0), 1.0)) for c in color)
    return red, green, blue
