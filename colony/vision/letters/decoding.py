"""Decodes the classes of columns to texts with their probabilities.

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


_LEAST = 1e-3
_BEAM = 12


def likely_texts(log_probabilities: Floats) -> dict[str, float]:
    """Return the most probable texts with their probabilities, by a beam search over a dozen prefixes.

    Args:
        log_probabilities: the log probability of each class at each column, (columns, classes).
    """
    probabilities = np.exp(log_probabilities.astype(np.float64))
    beam: dict[str, tuple[float, float]] = {"": (1.0, 0.0)}
    for column in probabilities:
        blank = float(column[BLANK])
        classes = np.flatnonzero(column[:BLANK] > _LEAST).tolist()
        characters = [(CHARACTERS[c], float(column[c])) for c in classes]
        beam = _longer(beam, blank, characters, column)
        if len(beam) > _BEAM:
            best = sorted(beam.items(), key=lambda entry: -sum(entry[1]))
            beam = dict(best[:_BEAM])
    return {text: ended + going for text, (ended, going) in beam.items()}


def _longer(
    beam: dict[str, tuple[float, float]],
    blank: float,
    characters: Sequence[tuple[str, float]],
    column: npt.NDArray[np.float64],
) -> dict[str, tuple[float, float]]:
    """Extend the prefixes by a column; each has the probabilities to end in a blank, and in a character."""
    longer: dict[str, tuple[float, float]] = {}
    for text, (ended, going) in beam.items():
        both = ended + going
        last = text[-1:]
        again = going * float(column[CHARACTERS.index(last)]) if last else 0.0
        old = longer.get(text, (0.0, 0.0))
        longer[text] = (old[0] + both * blank, old[1] + again)
        if len(text) == MAX_CHARACTERS:
            continue
        for character, probability in characters:
            start = (ended if character == last else both) * probability
            if start > 0.0:
                old = longer.get(text + character, (0.0, 0.0))
                longer[text + character] = (old[0], old[1] + start)
    return longer


class States(NamedTuple):
    """The emissions of texts, one text a row, (texts, states): the characters, and blanks around each.

    Attributes:
        classes: the class of each state.
        valid: True for the states of a text; the rest is padding.
        leaps: True for states that may be entered from two states before, without the blank between.
    """

    classes: npt.NDArray[np.intp]
    valid: npt.NDArray[np.bool_]
    leaps: npt.NDArray[np.bool_]


def states_of(texts: Sequence[str]) -> States:
    """Return the states of some texts, one at least; any of them may be empty."""
    longest = max(len(text) for text in texts)
    classes = np.full((len(texts), 2 * longest + 1), BLANK)
    valid = np.zeros(classes.shape, bool)
    for i, text in enumerate(texts):
        classes[i, 1 : 2 * len(text) : 2] = [CHARACTERS.index(c) for c in text]
        valid[i, : 2 * len(text) + 1] = True
    leaps = np.zeros(classes.shape, bool)
    leaps[:, 3::2] = classes[:, 3::2] != classes[:, 1:-2:2]
    return States(classes, valid, leaps & valid)


def log_probabilities_of(texts: Sequence[str], log_probabilities: Floats) -> npt.NDArray[np.float64]:
    """Return the log probability of each text, (texts); -inf where it does not fit into the columns.

    Args:
        texts: the texts.
        log_probabilities: the log probability of each class at each column, (columns, classes).
    """
    if not texts:
        return np.zeros(0)
    states = states_of(texts)
    emitted = np.exp(log_probabilities[:, states.classes].astype(np.float64)) * states.valid
    at = np.zeros(states.classes.shape)
    at[:, :2] = emitted[0, :, :2]
    total = np.zeros(len(texts))
    for column in emitted[1:]:
        ahead = at.copy()
        ahead[:, 1:] += at[:, :-1]
        ahead[:, 2:] += at[:, :-2] * states.leaps[:, 2:]
        at = ahead * column
        scale = at.sum(axis=1)
        scale[scale <= 0.0] = 1.0
        at /= scale[:, None]
        total += np.log(scale)
    last = 2 * np.array([len(text) for text in texts])
    each = np.arange(len(texts))
    end = at[each, last] + np.where(last > 0, at[each, last - 1], 0.0)
    with np.errstate(divide="ignore"):
        logs: npt.NDArray[np.float64] = total + np.log(end)
    return logs
