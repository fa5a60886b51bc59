"""The accuracy of a network on new samples, and the calibration of its confidence."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from colony.vision.detections import PlateReading
from colony.vision.letters.decoding import LetterNet
from colony.vision.plates.reader import plate_strip, reading_of, texts_of, weigh
from tools.training.samples import Sample, junk_sample, plate_sample
from tools.training.texts import door_text
from tools.training.views import random_height

SHARPNESSES = (0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5)
TRUSTS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Candidates for the trust in the prior, at most 1, as doors elsewhere may differ from the prior."""

_CALIBRATION_JUNK = 0.15
_MIN_PROBABILITY = 1e-4


class Score(NamedTuple):
    """The score of samples of plates: their number, and the number of texts read without errors."""

    samples: int
    correct: int


class JunkScore(NamedTuple):
    """The score of samples of junk.

    Attributes:
        samples: number of samples.
        read: number of samples read as a text.
        sure: number of these with a confidence of 0.9 or more.
    """

    samples: int
    read: int
    sure: int


def calibrate(net: LetterNet, fonts: Sequence[Path], count: int, random: np.random.Generator) -> LetterNet:
    """Return the network with the sharpness and the trust in its prior that fit `count` samples best.

    They maximize the likelihood of the samples' true texts.
    """
    seen: list[tuple[dict[str, float], float, str]] = []
    for _ in range(count):
        font = fonts[int(random.integers(len(fonts)))]
        if random.random() < _CALIBRATION_JUNK:
            sample = junk_sample(font, random)
        else:
            sample = plate_sample(door_text(random), font, random_height(random), random)
        strip = plate_strip(sample.image, sample.corners)
        if strip is not None:
            output = net.run(strip)
            seen.append((texts_of(output), output.plate_log_odds, sample.text))
    choices = (replace(net, sharpness=s, trust=t) for s, t in itertools.product(SHARPNESSES, TRUSTS))
    return min(
        choices,
        key=lambda choice: sum(_surprise(weigh(texts, plate, choice), text) for texts, plate, text in seen),
    )


def plate_score(
    net: LetterNet, font: Path, height_px: float, count: int, random: np.random.Generator
) -> Score:
    """Score samples of plates with texts as on doors, in a font, at a height in pixels."""
    samples = (plate_sample(door_text(random), font, height_px, random) for _ in range(count))
    return Score(count, sum(read(net, sample).text == sample.text for sample in samples))


def junk_score(net: LetterNet, fonts: Sequence[Path], count: int, random: np.random.Generator) -> JunkScore:
    """Score samples of junk."""
    samples = [junk_sample(fonts[i % len(fonts)], random) for i in range(count)]
    found = [reading for reading in (read(net, sample) for sample in samples) if reading.text]
    return JunkScore(count, len(found), sum(reading.confidence >= 0.9 for reading in found))


def read(net: LetterNet, sample: Sample) -> PlateReading:
    """Return the network's reading of a sample."""
    strip = plate_strip(sample.image, sample.corners)
    return PlateReading("", 1.0) if strip is None else reading_of(net.run(strip), net)


def _surprise(reading: PlateReading, text: str) -> float:
    """Return the negative logarithm of the probability that a reading gives to a text."""
    probability = dict(((reading.text, reading.confidence), *reading.alternatives)).get(text, 0.0)
    return -math.log(max(probability, _MIN_PROBABILITY))
