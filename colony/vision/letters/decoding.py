"""Decodes the class probabilities of columns to texts with their probabilities.

A text has many alignments to the columns: each character over one column or several, with optional blanks
between characters, and at least one between two equal ones. Its probability is the sum over all alignments
(connectionist temporal classification; Graves et al., ICML 2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from colony.nav.maps.signs import CHARACTERS
from colony.vision.letters.network import BLANK
from colony.vision.letters.prior import MAX_CHARACTERS

Floats = npt.NDArray[np.float32]


_MIN_PROBABILITY = 1e-3
_BEAM_WIDTH = 12


def likely_texts(log_probabilities: Floats) -> dict[str, float]:
    """Return the most probable texts with their probabilities, by a beam search over a dozen prefixes.

    Args:
        log_probabilities: the log probability of each class at each column, (columns, classes).
    """
    probabilities = np.exp(log_probabilities.astype(np.float64))
    beam: dict[str, tuple[float, float]] = {"": (1.0, 0.0)}
    for column in probabilities:
        blank = float(column[BLANK])
        classes = np.flatnonzero(column[:BLANK] > _MIN_PROBABILITY).tolist()
        characters = [(CHARACTERS[c], float(column[c])) for c in classes]
        beam = _extend(beam, blank, characters, column)
        if len(beam) > _BEAM_WIDTH:
            best = sorted(beam.items(), key=lambda entry: -sum(entry[1]))
            beam = dict(best[:_BEAM_WIDTH])
    return {text: in_blank + in_character for text, (in_blank, in_character) in beam.items()}


def _extend(
    beam: dict[str, tuple[float, float]],
    blank: float,
    characters: Sequence[tuple[str, float]],
    column: npt.NDArray[np.float64],
) -> dict[str, tuple[float, float]]:
    """Extend the prefixes by a column; each has its probabilities of ending in a blank and in a character."""
    extended: dict[str, tuple[float, float]] = {}
    for text, (in_blank, in_character) in beam.items():
        both = in_blank + in_character
        last = text[-1:]
        repeated = in_character * float(column[CHARACTERS.index(last)]) if last else 0.0
        before = extended.get(text, (0.0, 0.0))
        extended[text] = (before[0] + both * blank, before[1] + repeated)
        if len(text) == MAX_CHARACTERS:
            continue
        for character, probability in characters:
            start = (in_blank if character == last else both) * probability
            if start > 0.0:
                before = extended.get(text + character, (0.0, 0.0))
                extended[text + character] = (before[0], before[1] + start)
    return extended


class States(NamedTuple):
    """The states of texts, one text per row, (texts, states): the characters, with blanks around them.

    Attributes:
        classes: the class of each state.
        valid: True for the states of a text; the rest is padding.
        skips: True for states that may be entered from the one two before, skipping the blank between them.
    """

    classes: npt.NDArray[np.intp]
    valid: npt.NDArray[np.bool_]
    skips: npt.NDArray[np.bool_]


def states_of(texts: Sequence[str]) -> States:
    """Return the states of at least one text; texts may be empty."""
    longest = max(len(text) for text in texts)
    classes = np.full((len(texts), 2 * longest + 1), BLANK)
    valid = np.zeros(classes.shape, bool)
    for i, text in enumerate(texts):
        classes[i, 1 : 2 * len(text) : 2] = [CHARACTERS.index(c) for c in text]
        valid[i, : 2 * len(text) + 1] = True
    skips = np.zeros(classes.shape, bool)
    skips[:, 3::2] = classes[:, 3::2] != classes[:, 1:-2:2]
    return States(classes, valid, skips & valid)


def log_probabilities_of(texts: Sequence[str], log_probabilities: Floats) -> npt.NDArray[np.float64]:
    """Return the log probability of each text, (texts); -inf if it is too long for the columns.

    Args:
        texts: the texts.
        log_probabilities: the log probability of each class at each column, (columns, classes).
    """
    if not texts:
        return np.zeros(0)
    states = states_of(texts)
    emitted = np.exp(log_probabilities[:, states.classes].astype(np.float64)) * states.valid
    state = np.zeros(states.classes.shape)
    state[:, :2] = emitted[0, :, :2]
    total = np.zeros(len(texts))
    for column in emitted[1:]:
        following = state.copy()
        following[:, 1:] += state[:, :-1]
        following[:, 2:] += state[:, :-2] * states.skips[:, 2:]
        state = following * column
        scale = state.sum(axis=1)
        scale[scale <= 0.0] = 1.0
        state /= scale[:, None]
        total += np.log(scale)
    last = 2 * np.array([len(text) for text in texts])
    rows = np.arange(len(texts))
    end = state[rows, last] + np.where(last > 0, state[rows, last - 1], 0.0)
    with np.errstate(divide="ignore"):
        logs: npt.NDArray[np.float64] = total + np.log(end)
    return logs
