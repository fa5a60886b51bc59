"""The prior of the texts on door plates: the probability of each room number or word.

Room numbers have one to five digits, perhaps with a letter before or after them. Some doors have words that
are common to many buildings. The rest are arbitrary strings of letters, or of letters and digits. The prior
does not list the rooms of any building; those of a map are given as a lexicon.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cache

SHAPES = {
    "0": 0.02, "00": 0.10, "000": 0.37, "0000": 0.15, "00000": 0.01,
    "A0": 0.01, "A00": 0.04, "A000": 0.12, "A0000": 0.02,
    "0A": 0.005, "00A": 0.015, "000A": 0.04, "0000A": 0.01,
    "A": 0.004, "AA": 0.004, "AAA": 0.004, "AAAA": 0.004, "AAAAA": 0.004,
}  # fmt: skip
"""Frequencies of the shapes of texts: a 0 is any digit, an A any letter.

Next to digits, the letters I and O are left out, as in the usual rules for room numbers.
"""

ROOM_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"

WORDS = (
    "BOYS", "CLASS", "CLOSE", "COPY", "DEAN", "ELEC", "ELEV", "EXIT", "FIRE", "GIRLS", "GYM", "HALL",
    "JAN", "JANIT", "KITCH", "LAB", "LADIE", "LIBRA", "LIFT", "LOBBY", "LOUNG", "MAIL", "MECH", "MEETI",
    "MEN", "OFFIC", "PRINT", "ROOM", "SHOP", "STAFF", "STAIR", "STORA", "STUDY", "TOILE", "WC", "WOMEN",
)  # fmt: skip
"""Common words on doors, cut to five characters."""

WORD_FRACTION = 0.06
"""Fraction of plates that have one of the words."""

ARBITRARY_FRACTION = 0.01
"""Fraction of plates that have arbitrary digits and letters."""

MAX_CHARACTERS = 5
"""Maximum number of characters on a plate."""

LEXICON_PROBABILITY = 0.97
"""Probability that a plate has one of a lexicon's texts, if a lexicon is given."""


def log_prior(text: str, lexicon: Collection[str] = ()) -> float:
    """Return the natural log of a text's probability on a plate relative to that in random strings.

    Args:
        text: digits and capital letters, not empty.
        lexicon: texts of the map; a plate has one of them with probability `LEXICON_PROBABILITY`, all equally
            likely.
    """
    probability = _probability(text)
    if lexicon:
        in_lexicon = LEXICON_PROBABILITY / len(lexicon) if text in lexicon else 0.0
        probability = in_lexicon + (1.0 - LEXICON_PROBABILITY) * probability
    return math.log(probability / _random_probability(text))


@cache
def _probability(text: str) -> float:
    """Return the probability of a text on a plate, without a lexicon."""
    shape = "".join("0" if c.isdigit() else "A" for c in text)
    letters = len(ROOM_LETTERS) if "0" in shape else 26
    choices = math.prod(10 if c == "0" else letters for c in shape)
    is_room = "0" not in shape or all(c.isdigit() or c in ROOM_LETTERS for c in text)
    room = SHAPES.get(shape, 0.0) / choices if is_room else 0.0
    word = WORD_FRACTION / len(WORDS) if text in WORDS else 0.0
    return room + word + ARBITRARY_FRACTION * _random_probability(text)


def _random_probability(text: str) -> float:
    return 1.0 / (MAX_CHARACTERS * 36.0 ** len(text))
