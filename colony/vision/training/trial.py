"""The accuracy of a network on plates it has never seen, and the calibration of its confidence."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from colony.vision.letters.network import LetterNet
from colony.vision.plates.reader import reading_of, texts_of, weighed
from colony.vision.plates.strip import plate_strip
from colony.vision.sightings import Reading
from colony.vision.training.samples import Look, junk_look, plate_look
from colony.vision.training.texts import door_text
from colony.vision.training.views import drawn_height

SHARPNESSES = (0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5)
TRUSTS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""No more than 1: doors elsewhere may have other texts than the prior says."""

_CALIBRATION_JUNK = 0.15
_LEAST = 1e-4


class Score(NamedTuple):
    """The score of some looks at plates: their number, and the number read right as a whole."""

    looks: int
    right: int


class JunkScore(NamedTuple):
    """The score of some looks at what is no plate.

    Their number, the number that were read as something, and the number of these with a confidence of 0.9 and
    more.
    """

    looks: int
    read: int
    sure: int


def calibrated(net: LetterNet, fonts: Sequence[Path], count: int, random: np.random.Generator) -> LetterNet:
    """Return the network with the sharpness and the trust in its prior that fit `count` looks best.

    They make the right readings of these looks most probable.
    """
    seen: list[tuple[dict[str, float], float, str]] = []
    for _ in range(count):
        font = fonts[int(random.integers(len(fonts)))]
        if random.random() < _CALIBRATION_JUNK:
            look = junk_look(font, random)
        else:
            look = plate_look(door_text(random), font, drawn_height(random), random)
        strip = plate_strip(look.image, look.corners)
        if strip is not None:
            told = net.look(strip)
            seen.append((texts_of(told), told.plate, look.text))
    choices = (replace(net, sharpness=s, trust=t) for s, t in itertools.product(SHARPNESSES, TRUSTS))
    return min(
        choices,
        key=lambda choice: sum(_surprise(weighed(texts, plate, choice), text) for texts, plate, text in seen),
    )


def plate_score(
    net: LetterNet, font: Path, height_px: float, count: int, random: np.random.Generator
) -> Score:
    """Score single looks at plates with texts as on doors, in a font, at a height in pixels."""
    looks = (plate_look(door_text(random), font, height_px, random) for _ in range(count))
    return Score(count, sum(read(net, look).text == look.text for look in looks))


def junk_score(net: LetterNet, fonts: Sequence[Path], count: int, random: np.random.Generator) -> JunkScore:
    """Score single looks at what is no plate."""
    looks = [junk_look(fonts[i % len(fonts)], random) for i in range(count)]
    found = [reading for reading in (read(net, look) for look in looks) if reading.text]
    return JunkScore(count, len(found), sum(reading.confidence >= 0.9 for reading in found))


def read(net: LetterNet, look: Look) -> Reading:
    """Return the network's reading of a look."""
    strip = plate_strip(look.image, look.corners)
    return Reading("", 1.0) if strip is None else reading_of(net.look(strip), net)


def _surprise(reading: Reading, text: str) -> float:
    """Return the negative logarithm of the probability that a reading gives to a text."""
    share = dict(((reading.text, reading.confidence), *reading.alternatives)).get(text, 0.0)
    return -math.log(max(share, _LEAST))
