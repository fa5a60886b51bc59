"""The reader of the characters on door plates (thesis section 5.7 finds the plates, but does not read them).

A plate is cut out of the image as a small strip, and a network classifies each column of the strip. The most
probable texts follow from the classes and a prior: the usual texts on doors, or the doors of the map.
Readings of several images of a plate are combined by multiplying their probabilities.

A box that holds no plate, or only a part of one, reads as "": the network is also trained on such boxes.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt

from colony.nav.maps.signs import CHARACTERS
from colony.vision.detections import Corner, PlateBox, PlateReading
from colony.vision.gray_images import Gray, gray_image
from colony.vision.letters.decoding import (
    MAX_CHARACTERS,
    LetterNet,
    NetworkOutput,
    likely_texts,
    log_prior,
    log_probabilities_of,
    network,
)

# --- strip --------------------------------------------------------------------------------------------
#
# Cuts a door plate out of an image, as a small upright strip of fixed size and contrast for the reader.
#
# The plate is warped from its four corners. If it is larger in the image than in the strip, areas are
# averaged.

STRIP_ROWS, STRIP_COLUMNS = 24, 64

PLATE_LEFT, PLATE_RIGHT, PLATE_TOP, PLATE_BOTTOM = 2.5, 60.5, 1.5, 21.5
"""Edges of the plate in the strip, with a margin for inaccurate corners."""

MIN_CONTRAST = 6.0
"""Minimum standard deviation of the gray levels that is normalized to 1; stretching strips with less would
amplify noise."""

_MAX_SAMPLES = 4
_MIN_AREA = 12.0
_MAX_COORDINATE = 1e5

Floats = npt.NDArray[np.float32]
Corners = tuple[Corner, Corner, Corner, Corner]


def plate_strip(image: Gray, corners: Corners) -> Floats | None:
    """Cut out the strip of a plate.

    Args:
        image: uint8, (rows, columns), or with a last axis of one or three channels.
        corners: corners of the plate in the image, clockwise from the upper left; they may be outside of it,
            where the pixels at its border are repeated.

    Returns:
        (24, 64), with mean 0 and, with sufficient contrast, standard deviation 1; None if the corners are not
        finite, or not an upright convex quadrilateral of some pixels.

    Raises:
        ValueError: `image` is not such an image.
    """
    gray = gray_image(image)
    if not _is_plate(corners):
        return None
    import cv2

    samples = _samples(corners)
    plate_corners = np.array(
        [
            [PLATE_LEFT, PLATE_TOP], [PLATE_RIGHT, PLATE_TOP],
            [PLATE_RIGHT, PLATE_BOTTOM], [PLATE_LEFT, PLATE_BOTTOM],
        ], np.float32
    )  # fmt: skip
    target = (plate_corners + 0.5) * samples - 0.5
    transform: Any = cv2.getPerspectiveTransform(target.astype(np.float32), np.array(corners, np.float32))
    size = (STRIP_COLUMNS * samples, STRIP_ROWS * samples)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    fine = cv2.warpPerspective(gray, transform, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    cells = fine.reshape(STRIP_ROWS, samples, STRIP_COLUMNS, samples)
    return _stretched(cells.mean(axis=(1, 3), dtype=np.float32))


def _is_plate(corners: Corners) -> bool:
    """Return True if the corners go clockwise (with rows downward) around a convex area of some pixels."""
    if not all(math.isfinite(x) and abs(x) < _MAX_COORDINATE for corner in corners for x in corner):
        return False
    turns = []
    for i in range(4):
        (ax, ay), (bx, by), (cx, cy) = (corners[(i + k) % 4] for k in range(3))
        turns.append((bx - ax) * (cy - by) - (by - ay) * (cx - bx))
    is_upright = corners[0][0] < corners[1][0] and corners[0][1] < corners[3][1]
    return is_upright and min(turns) > 0.0 and sum(turns) / 4.0 >= _MIN_AREA


def _samples(corners: Corners) -> int:
    """Return the number of samples per pixel of the strip in each direction."""
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners
    width = max(math.hypot(bx - ax, by - ay), math.hypot(cx - dx, cy - dy))
    height = max(math.hypot(dx - ax, dy - ay), math.hypot(cx - bx, cy - by))
    scale = max(width / (PLATE_RIGHT - PLATE_LEFT), height / (PLATE_BOTTOM - PLATE_TOP))
    return max(1, min(_MAX_SAMPLES, math.ceil(scale)))


def _stretched(strip: Floats) -> Floats:
    centered = strip - strip.mean()
    stretched: Floats = centered / np.float32(max(float(centered.std()), MIN_CONTRAST))
    return stretched


# --- reader -------------------------------------------------------------------------------------------

NOTHING = PlateReading("", 1.0)
"""Reading of a box that certainly does not hold a plate."""

ALTERNATIVES = 8
"""Maximum number of alternative texts of a reading."""

_WRONG_READING_PROBABILITY = 2e-3
"""Probability assigned to every text for an entirely wrong reading, so that one reading cannot overrule the
others."""

_MIN_PROBABILITY = 1e-4


def read_plate(
    image: npt.NDArray[np.uint8],
    box: PlateBox,
    *,
    lexicon: Collection[str] | None = None,
) -> PlateReading:
    """Read the text on a plate.

    Args:
        image: uint8, (rows, columns), or with a last axis of one or three channels.
        box: the plate's box; its corners may be off by a pixel or two.
        lexicon: texts of the map's plates; any other text is then read only if it is very clear.

    Returns:
        The most probable text and its probability, with the next most probable ones in `alternatives`; "" if
        the box holds no plate.

    Raises:
        ValueError: `image` is not such an image, or the lexicon has a text that no plate can have.
    """
    texts = frozenset(lexicon or ())
    wrong = sorted(text for text in texts if not _is_text(text))
    if wrong:
        expected = f"1 to {MAX_CHARACTERS} characters, digits and capital letters"
        raise ValueError(f"the lexicon has the text {wrong[0]!r}; expected {expected}")
    strip = plate_strip(image, box.corners)
    if strip is None:
        return NOTHING
    net = network()
    return reading_of(net.run(strip), net, texts)


def reading_of(output: NetworkOutput, net: LetterNet, lexicon: Collection[str] = ()) -> PlateReading:
    """Return the reading of a strip from the network's output."""
    return weigh(texts_of(output, lexicon), output.plate_log_odds, net, lexicon)


def texts_of(output: NetworkOutput, lexicon: Collection[str] = ()) -> dict[str, float]:
    """Return the likely texts of a strip, and those of the lexicon, with their log probabilities.

    The probabilities are those of the columns alone, without the prior.
    """
    table = output.log_probabilities
    log_probabilities = {text: math.log(p) for text, p in likely_texts(table).items() if text and p > 0.0}
    missing = sorted(text for text in lexicon if text not in log_probabilities)
    log_probabilities |= zip(missing, log_probabilities_of(missing, table).tolist(), strict=True)
    return log_probabilities


def weigh(
    log_probabilities: dict[str, float], plate_log_odds: float, net: LetterNet, lexicon: Collection[str] = ()
) -> PlateReading:
    """Return the reading by the network's output and the prior.

    Args:
        log_probabilities: the result of `texts_of`.
        plate_log_odds: log odds that the strip is a plate.
        net: the network, for its calibration.
        lexicon: the texts of the map's plates.
    """
    weights = {
        text: net.sharpness * log + net.trust * log_prior(text, lexicon)
        for text, log in log_probabilities.items()
        if log > -math.inf
    }
    if not weights:
        return NOTHING
    top = max(weights.values())
    log_total = top + math.log(sum(math.exp(weight - top) for weight in weights.values()))
    weights = {text: weight - log_total - _softplus(-plate_log_odds) for text, weight in weights.items()}
    return _reading({"": -_softplus(plate_log_odds), **weights})


def combine_readings(readings: Iterable[PlateReading]) -> PlateReading:
    """Combine several readings of one plate, assumed to be independent: their probabilities multiply.

    Readings of "" count as well: if most are, so is the result. Without any readings it is "" with confidence
    0.
    """
    tables = [dict(((reading.text, reading.confidence), *reading.alternatives)) for reading in readings]
    if not tables:
        return PlateReading("", 0.0)
    texts = {text for table in tables for text in table}
    return _reading(
        {
            text: sum(math.log(table.get(text, 0.0) + _WRONG_READING_PROBABILITY) for table in tables)
            for text in texts
        }
    )


def _reading(weights: dict[str, float]) -> PlateReading:
    """Return the reading of texts whose probabilities are proportional to the exponentials of the weights."""
    top = max(weights.values())
    likelihoods = {text: math.exp(weight - top) for text, weight in weights.items()}
    total = sum(likelihoods.values())
    ranked = sorted(likelihoods.items(), key=lambda entry: (-entry[1], entry[0]))
    text, likelihood = ranked[0]
    others = islice(ranked[1:], ALTERNATIVES)
    return PlateReading(
        text, likelihood / total, tuple((t, s / total) for t, s in others if s > _MIN_PROBABILITY * total)
    )


def _softplus(x: float) -> float:
    """Return log(1 + exp(x)): minus the logarithm of a probability whose log odds are -x."""
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


def _is_text(text: str) -> bool:
    return 1 <= len(text) <= MAX_CHARACTERS and all(c in CHARACTERS for c in text)
