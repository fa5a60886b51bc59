"""The reader of the characters on door plates (thesis section 5.7 finds the plates, but does not read them).

A plate is cut out of the image as a small strip; a network classifies each column of it; the most probable
texts follow from these, given what is usual on doors, or the doors of the map. Several looks at a plate give
more information than one: their probabilities multiply.

A box that holds no plate, or a part of one only, reads as "": the network has learned that from such boxes.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from itertools import islice

import numpy as np
import numpy.typing as npt

from colony.nav.maps.signs import CHARACTERS
from colony.vision.letters.decoding import likely_texts, log_probabilities_of
from colony.vision.letters.network import LetterNet, Look, network
from colony.vision.letters.prior import LONGEST, log_prior
from colony.vision.plates.strip import plate_strip
from colony.vision.sightings import PlateBox, Reading

NOTHING = Reading("", 1.0)
"""Reading where there is certainly no plate."""

ALTERNATIVES = 8
"""Largest number of alternative texts of a reading."""

_ASTRAY = 2e-3
"""Probability of any text in a look that is wholly wrong: so one look cannot overrule all others."""

_LEAST = 1e-4


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
        lexicon: the texts of the map's plates; a text that is not among them is then read only where it is
            plain to see.

    Returns:
        The most probable text and its probability, with the next ones in `alternatives`; "" if the box holds
        no plate.

    Raises:
        ValueError: it is no such image, or the lexicon has a text that no plate has.
    """
    texts = frozenset(lexicon or ())
    wrong = sorted(text for text in texts if not _is_text(text))
    if wrong:
        expected = f"1 to {LONGEST} characters, digits and capital letters"
        raise ValueError(f"the lexicon has the text {wrong[0]!r}; expected {expected}")
    strip = plate_strip(image, box.corners)
    if strip is None:
        return NOTHING
    net = network()
    return reading_of(net.look(strip), net, texts)


def reading_of(look: Look, net: LetterNet, lexicon: Collection[str] = ()) -> Reading:
    """Return the reading of a strip from the network's output."""
    return weighed(texts_of(look, lexicon), look.plate, net, lexicon)


def texts_of(look: Look, lexicon: Collection[str] = ()) -> dict[str, float]:
    """Return the texts that a strip may have, and all of the lexicon, with their log probabilities.

    The probabilities are those of the columns alone, without the prior.
    """
    table = look.log_probabilities
    seen = {text: math.log(p) for text, p in likely_texts(table).items() if text and p > 0.0}
    known = sorted(text for text in lexicon if text not in seen)
    seen |= zip(known, log_probabilities_of(known, table).tolist(), strict=True)
    return seen


def weighed(seen: dict[str, float], plate: float, net: LetterNet, lexicon: Collection[str] = ()) -> Reading:
    """Return the reading that follows from the observation and the prior.

    Args:
        seen: the result of `texts_of`.
        plate: the log odds that it is a plate.
        net: the network, for its calibration.
        lexicon: the texts of the map's plates.
    """
    weights = {
        text: net.sharpness * log + net.trust * log_prior(text, lexicon)
        for text, log in seen.items()
        if log > -math.inf
    }
    if not weights:
        return NOTHING
    top = max(weights.values())
    whole = top + math.log(sum(math.exp(weight - top) for weight in weights.values()))
    weights = {text: weight - whole - _softplus(-plate) for text, weight in weights.items()}
    return _reading({"": -_softplus(plate), **weights})


def combined(readings: Iterable[Reading]) -> Reading:
    """Combine several looks at one plate, taken as independent: their probabilities multiply.

    Looks that saw no plate count as well: where most of them did, the result is "". Without any readings it
    is "" too, with confidence 0.
    """
    looks = [dict(((reading.text, reading.confidence), *reading.alternatives)) for reading in readings]
    if not looks:
        return Reading("", 0.0)
    texts = {text for look in looks for text in look}
    return _reading({text: sum(math.log(look.get(text, 0.0) + _ASTRAY) for look in looks) for text in texts})


def _reading(weights: dict[str, float]) -> Reading:
    """Return the texts by their probabilities, in proportion to the exponentials of the weights."""
    top = max(weights.values())
    shares = {text: math.exp(weight - top) for text, weight in weights.items()}
    whole = sum(shares.values())
    ranked = sorted(shares.items(), key=lambda entry: (-entry[1], entry[0]))
    text, share = ranked[0]
    others = islice(ranked[1:], ALTERNATIVES)
    return Reading(text, share / whole, tuple((t, s / whole) for t, s in others if s > _LEAST * whole))


def _softplus(x: float) -> float:
    """Return log(1 + exp(x)): minus the logarithm of a probability whose log odds are -x."""
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


def _is_text(text: str) -> bool:
    return 1 <= len(text) <= LONGEST and all(c in CHARACTERS for c in text)
