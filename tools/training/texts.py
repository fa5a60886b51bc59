"""The texts of the plates in training samples."""

from __future__ import annotations

import numpy as np

from colony.nav.maps.signs import CHARACTERS
from colony.vision.letters.decoding import MAX_CHARACTERS, ROOM_LETTERS, SHAPES, WORD_FRACTION, WORDS

_DIGITS, _LETTERS = CHARACTERS[:10], CHARACTERS[10:]


def any_text(random: np.random.Generator) -> str:
    """Draw one to five characters, uniformly, so that the network does not learn them by context alone."""
    return "".join(random.choice(list(CHARACTERS), int(random.integers(1, MAX_CHARACTERS + 1))).tolist())


def door_text(random: np.random.Generator) -> str:
    """Draw a text as on doors: a room number, or a word."""
    if random.random() < WORD_FRACTION:
        return str(random.choice(WORDS))
    frequencies = np.array(list(SHAPES.values()))
    shape = list(SHAPES)[int(random.choice(len(frequencies), p=frequencies / frequencies.sum()))]
    letters = ROOM_LETTERS if "0" in shape else _LETTERS
    return "".join(str(random.choice(list(_DIGITS if c == "0" else letters))) for c in shape)
