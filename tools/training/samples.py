"""Training samples: rectified images (strips) of plates with their texts, and of other objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from colony.vision.plates.reader import STRIP_COLUMNS, STRIP_ROWS, Corners, plate_strip
from tools.training import lettering, views
from tools.training.texts import any_text, door_text

Floats = npt.NDArray[np.float32]

JUNK_FRACTION = 0.3
"""Fraction of samples that are not plates."""


class Batch(NamedTuple):
    """Strips (samples, 24, 64), and the text of each; "" for strips that are not plates."""

    strips: Floats
    texts: list[str]


class Sample(NamedTuple):
    """A plate, or junk, in an image, with the corners that a detector may find."""

    image: npt.NDArray[np.uint8]
    corners: Corners
    text: str


def batch(count: int, fonts: Sequence[Path], random: np.random.Generator) -> Batch:
    """Draw a batch of samples in these fonts; `JUNK_FRACTION` of them are junk."""
    strips, texts = np.zeros((count, STRIP_ROWS, STRIP_COLUMNS), np.float32), []
    for i in range(count):
        font = fonts[int(random.integers(len(fonts)))]
        if random.random() < JUNK_FRACTION:
            sample = junk_sample(font, random)
        else:
            text = door_text(random) if random.random() < 0.5 else any_text(random)
            sample = plate_sample(text, font, views.random_height(random), random)
        strip = plate_strip(sample.image, sample.corners)
        if strip is not None:
            strips[i] = strip
        texts.append(sample.text if strip is not None else "")
    return Batch(strips, texts)


def plate_sample(
    text: str, font: Path, height_px: float, random: np.random.Generator, slant_deg: float | None = None
) -> Sample:
    """Draw a sample of a plate, with characters of `height_px` pixels."""
    seen = views.view(lettering.plate(text, font, random), height_px, random, slant_deg)
    return Sample(seen.image, views.jittered(seen.corners, random), text)


def junk_sample(font: Path, random: np.random.Generator) -> Sample:
    """Draw a sample of something other than a plate, or of a misplaced box."""
    height = views.random_height(random)
    kind = random.random()
    if kind < 0.4:
        seen = views.view(lettering.plate(door_text(random), font, random), height, random)
        return Sample(seen.image, views.misplaced(seen.corners, random), "")
    if kind < 0.6:
        picture = lettering.paper([door_text(random) for _ in range(5)], font, random)
    elif kind < 0.7:
        picture = lettering.inverted_plate(door_text(random), font, random)
    else:
        picture = lettering.clutter(random)
    seen = views.view(picture, height, random)
    return Sample(seen.image, views.jittered(seen.corners, random), "")
