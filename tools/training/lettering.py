"""Pictures of door plates, and of other objects, at 2 mm per pixel, before the simulated camera."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from colony.nav.maps.signs import CHARACTER_HEIGHT_MM, PLATE_HEIGHT_MM, PLATE_WIDTH_MM

Gray = npt.NDArray[np.uint8]

MM_PER_PIXEL = 2.0
WIDTH, HEIGHT = round(PLATE_WIDTH_MM / MM_PER_PIXEL), round(PLATE_HEIGHT_MM / MM_PER_PIXEL)

_CAPITALS = CHARACTER_HEIGHT_MM / PLATE_HEIGHT_MM
_FONT_PIXELS = 64
_MAX_WIDTH_FRACTION = 0.95


def plate(text: str, font: Path, random: np.random.Generator) -> Gray:
    """Draw a plate with a text: light characters on a dark ground, (64, 178).

    Their size, width, slant and spacing vary a little.
    """
    ground, light = random.uniform(5.0, 70.0), random.uniform(150.0, 255.0)
    picture = np.full((HEIGHT, WIDTH), ground, np.float32)
    if random.random() < 0.15:
        edge = int(random.integers(1, 4))
        for rows in (slice(None, edge), slice(-edge, None)):
            picture[rows] = ground + random.uniform(0.0, 0.7) * (light - ground)
    height = _CAPITALS * HEIGHT * random.normal(1.0, 0.04)
    ink = _line(text, font, height, random)
    top = (HEIGHT - ink.shape[0]) // 2 + int(random.integers(-2, 3))
    left = (WIDTH - ink.shape[1]) // 2 + int(random.integers(-3, 4))
    _draw_ink(picture, ink, (top, left), light)
    return picture.astype(np.uint8)


def paper(texts: list[str], font: Path, random: np.random.Generator) -> Gray:
    """Draw a notice: some lines of small characters, dark on light or light on dark."""
    ground, light = random.uniform(0.0, 255.0), random.uniform(0.0, 255.0)
    picture = np.full((HEIGHT, WIDTH), ground, np.float32)
    lines = max(1, min(len(texts), int(random.integers(1, 6))))
    for i in range(lines):
        ink = _line(texts[i], font, HEIGHT / lines * random.uniform(0.35, 0.75), random)
        _draw_ink(
            picture, ink, (round(HEIGHT / lines * (i + 0.2)), int(random.integers(-20, WIDTH // 2))), light
        )
    return picture.astype(np.uint8)


def inverted_plate(text: str, font: Path, random: np.random.Generator) -> Gray:
    """Draw a plate with inverted colors: dark characters on a light ground."""
    return 255 - plate(text, font, random)


def clutter(random: np.random.Generator) -> Gray:
    """Draw clutter: an empty plate, spots, bars, bricks, stripes or grain."""
    import cv2

    picture = np.full((HEIGHT, WIDTH), random.uniform(0.0, 200.0), np.float32)
    match int(random.integers(5)):
        case 0:
            picture += np.linspace(0.0, random.uniform(-60.0, 60.0), WIDTH, dtype=np.float32)
        case 1:
            for _ in range(int(random.integers(1, 12))):
                center = int(random.integers(WIDTH)), int(random.integers(HEIGHT))
                axes = int(random.integers(2, 50)), int(random.integers(2, 30))
                angle = float(random.uniform(0.0, 180.0))
                shade = random.uniform(0.0, 255.0)
                cv2.ellipse(picture, center, axes, angle, 0.0, 360.0, shade, -1)
        case 2:
            for _ in range(int(random.integers(1, 10))):
                corner = int(random.integers(-20, WIDTH)), int(random.integers(-20, HEIGHT))
                far = corner[0] + int(random.integers(3, 90)), corner[1] + int(random.integers(3, 60))
                cv2.rectangle(picture, corner, far, random.uniform(0.0, 255.0), -1)
        case 3:
            wide, high = int(random.integers(12, 70)), int(random.integers(10, 40))
            mortar, shade = int(random.integers(2, 6)), random.uniform(0.0, 255.0)
            phase = int(random.integers(70))
            is_striped = random.random() < 0.3
            picture[:, (np.arange(WIDTH) + phase) % wide < (wide // 2 if is_striped else mortar)] = shade
            if not is_striped:
                picture[(np.arange(HEIGHT) + phase) % high < mortar] = shade
        case _:
            coarse = random.uniform(0.0, 255.0, (int(random.integers(3, 16)), int(random.integers(4, 40))))
            picture[:] = cv2.resize(coarse.astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return np.clip(picture, 0.0, 255.0).astype(np.uint8)


def _draw_ink(picture: npt.NDArray[np.float32], ink: Gray, corner: tuple[int, int], light: float) -> None:
    """Draw characters into a picture, clipped to it; `corner` is their top and left."""
    top, left = corner
    up, start = max(0, top), max(0, left)
    down, end = min(HEIGHT, top + ink.shape[0]), min(WIDTH, left + ink.shape[1])
    if up < down and start < end:
        coverage = ink[up - top : down - top, start - left : end - left].astype(np.float32) / 255.0
        region = picture[up:down, start:end]
        region += coverage * (np.float32(light) - region)


def _line(text: str, font: Path, height: float, random: np.random.Generator) -> Gray:
    """Return a text's ink, from 0 to 255, with capitals of `height` pixels; no wider than a plate."""
    import cv2
    from PIL import Image, ImageDraw

    loaded_font, capital = _load_font(font)
    spacing = random.uniform(-0.03, 0.16) * capital
    lengths = [loaded_font.getlength(c) + spacing for c in text]
    image = Image.new("L", (int(sum(lengths)) + capital, 2 * capital))
    pen, at = ImageDraw.Draw(image), capital / 2.0
    for character, length in zip(text, lengths, strict=True):
        pen.text((at, 1.5 * capital), character, fill=255, font=loaded_font, anchor="ls")
        at += length
    ink: Gray = np.asarray(image)
    if random.random() < 0.25:
        slant = random.uniform(-0.08, 0.22)
        shear = np.array([[1.0, slant, -slant * 1.5 * capital], [0.0, 1.0, 0.0]], np.float32)
        ink = np.asarray(cv2.warpAffine(ink, shear, (ink.shape[1], ink.shape[0])), np.uint8)
    ink = _cropped(ink)
    scale = height / capital
    wide = ink.shape[1] * scale * random.uniform(0.78, 1.15)
    wide = max(2.0, min(wide, random.uniform(_MAX_WIDTH_FRACTION - 0.08, _MAX_WIDTH_FRACTION) * WIDTH))
    size = max(2, round(wide)), max(2, round(ink.shape[0] * scale))
    return np.asarray(cv2.resize(ink, size, interpolation=cv2.INTER_AREA), np.uint8)


def _cropped(ink: Gray) -> Gray:
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    return ink[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


@cache
def _load_font(font: Path) -> tuple[Any, int]:
    """Return the font, and the height of its capitals in pixels."""
    from PIL import ImageFont

    loaded_font = ImageFont.truetype(str(font), _FONT_PIXELS)
    _, top, _, bottom = loaded_font.getbbox("H", anchor="ls")
    return loaded_font, int(bottom - top)
