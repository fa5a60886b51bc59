"""The texts of the plates from which characters are learned."""

from __future__ import annotations

import numpy as np

from colony.nav.maps.signs import CHARACTERS
from colony.vision.letters.prior import LONGEST, ROOM_LETTERS, SHAPES, WORD_SHARE, WORDS

_DIGITS, _LETTERS = CHARACTERS[:10], CHARACTERS[10:]


def any_text(random: np.random.Generator) -> str:
    """Draw one to five of all characters, all equally often: so that context alone teaches none."""
    return "".join(random.choice(list(CHARACTERS), int(random.integers(1, LONGEST + 1))).tolist())


def door_text(random: np.random.Generator) -> str:
    """Draw a text as on doors: the number of a room, or a word."""
    if random.random() < WORD_SHARE:
        return str(random.choice(WORDS))
    shares = np.array(list(SHAPES.values()))
    shape = list(SHAPES)[int(random.choice(len(shares), p=shares / shares.sum()))]
    letters = ROOM_LETTERS if "0" in shape else _LETTERS
    return "".join(str(random.choice(list(_DIGITS if c == "0" else letters))) for c in shape)
