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

import numpy as np
import numpy.typing as npt

from colony.nav.maps.signs import CHARACTERS
from colony.vision.detections import PlateBox, Reading
from colony.vision.letters.decoding import likely_texts, log_probabilities_of
from colony.vision.letters.network import LetterNet, NetworkOutput, network
from colony.vision.letters.prior import MAX_CHARACTERS, log_prior
from colony.vision.plates.strip import plate_strip

NOTHING = Reading("", 1.0)
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
) -> Reading:
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


def reading_of(output: NetworkOutput, net: LetterNet, lexicon: Collection[str] = ()) -> Reading:
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
) -> Reading:
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


def combine_readings(readings: Iterable[Reading]) -> Reading:
    """Combine several readings of one plate, assumed to be independent: their probabilities multiply.

    Readings of "" count as well: if most are, so is the result. Without any readings it is "" with confidence
    0.
    """
    tables = [dict(((reading.text, reading.confidence), *reading.alternatives)) for reading in readings]
    if not tables:
        return Reading("", 0.0)
    texts = {text for table in tables for text in table}
    return _reading(
        {
            text: sum(math.log(table.get(text, 0.0) + _WRONG_READING_PROBABILITY) for table in tables)
            for text in texts
        }
    )


def _reading(weights: dict[str, float]) -> Reading:
    """Return the reading of texts whose probabilities are proportional to the exponentials of the weights."""
    top = max(weights.values())
    likelihoods = {text: math.exp(weight - top) for text, weight in weights.items()}
    total = sum(likelihoods.values())
    ranked = sorted(likelihoods.items(), key=lambda entry: (-entry[1], entry[0]))
    text, likelihood = ranked[0]
    others = islice(ranked[1:], ALTERNATIVES)
    return Reading(
        text, likelihood / total, tuple((t, s / total) for t, s in others if s > _MIN_PROBABILITY * total)
    )


def _softplus(x: float) -> float:
    """Return log(1 + exp(x)): minus the logarithm of a probability whose log odds are -x."""
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


def _is_text(text: str) -> bool:
    return 1 <= len(text) <= MAX_CHARACTERS and all(c in CHARACTERS for c in text)
