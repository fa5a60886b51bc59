"""Samples to learn from: strips of plates with their texts, and of other things with none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from colony.vision.plates.strip import STRIP_COLUMNS, STRIP_ROWS, Corners, plate_strip
from colony.vision.training import lettering, views
from colony.vision.training.texts import any_text, door_text

Floats = npt.NDArray[np.float32]

JUNK_SHARE = 0.3
"""Fraction of samples that are no plate."""


class Batch(NamedTuple):
    """Strips (samples, 24, 64), and what is written on each; "" where it is no plate."""

    strips: Floats
    texts: list[str]


class Look(NamedTuple):
    """A plate, or junk, in an image: the box is as a detector may find it."""

    image: npt.NDArray[np.uint8]
    corners: Corners
    text: str


def batch(count: int, fonts: Sequence[Path], random: np.random.Generator) -> Batch:
    """Draw a batch of samples in the fonts, a part of them junk."""
    strips, texts = np.zeros((count, STRIP_ROWS, STRIP_COLUMNS), np.float32), []
    for i in range(count):
        font = fonts[int(random.integers(len(fonts)))]
        if random.random() < JUNK_SHARE:
            look = junk_look(font, random)
        else:
            text = door_text(random) if random.random() < 0.5 else any_text(random)
            look = plate_look(text, font, views.drawn_height(random), random)
        strip = plate_strip(look.image, look.corners)
        if strip is not None:
            strips[i] = strip
        texts.append(look.text if strip is not None else "")
    return Batch(strips, texts)


def plate_look(
    text: str, font: Path, height_px: float, random: np.random.Generator, slant_deg: float | None = None
) -> Look:
    """Draw a look at a plate, with characters of this height in pixels."""
    seen = views.view(lettering.plate(text, font, random), height_px, random, slant_deg)
    return Look(seen.image, views.jittered(seen.corners, random), text)


def junk_look(font: Path, random: np.random.Generator) -> Look:
    """Draw a look at something that is no plate, or a box that does not hold one."""
    height = views.drawn_height(random)
    kind = random.random()
    if kind < 0.4:
        seen = views.view(lettering.plate(door_text(random), font, random), height, random)
        return Look(seen.image, views.misplaced(seen.corners, random), "")
    if kind < 0.6:
        picture = lettering.paper([door_text(random) for _ in range(5)], font, random)
    elif kind < 0.7:
        picture = lettering.reversed_plate(door_text(random), font, random)
    else:
        picture = lettering.clutter(random)
    seen = views.view(picture, height, random)
    return Look(seen.image, views.jittered(seen.corners, random), "")
