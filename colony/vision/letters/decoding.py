"""Decodes the class probabilities of columns to texts with their probabilities.

A text has many alignments to the columns: each character over one column or several, with optional blanks
between characters, and at least one between two equal ones. Its probability is the sum over all alignments
(connectionist temporal classification; Graves et al., ICML 2006).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from colony.nav.maps.signs import CHARACTERS

# --- network ------------------------------------------------------------------------------------------
#
# The network that reads characters: a small convolutional network.
#
# Its input is a strip: the rectified image of a plate (`colony/vision/plates/reader.py`). For each of 32
# columns of the strip, it gives the probability of each character, and of no character. It has three
# convolutions of 3 by 3, each followed by rectification and the first two by pooling; then one over the whole
# height, one along the columns, and a linear layer to the classes. Characters need only a small receptive
# field; a separate head, a hidden layer over all columns, decides whether the whole strip is a plate. The
# weights are learned by `python -m tools.training` and stored as 8-bit integers with a scale for each
# channel.

Floats = npt.NDArray[np.float32]

CLASSES = len(CHARACTERS) + 1
BLANK = len(CHARACTERS)
"""Class of a column without a character of its own: before, between and after the characters."""

FRAMES = 32
"""Number of output columns: one per two columns of the strip."""

HEAD_AFTER = 4
"""Number of convolutions before the head."""

HEAD_POOL = (1, 4)
"""Rows and columns that are pooled before the head."""

POOLS = ((2, 2), (2, 1), (1, 1), (1, 1), (1, 1))
"""Rows and columns that are pooled after each convolution."""

PADS = ((1, 1), (1, 1), (1, 1), (0, 1), (0, 1))
"""Rows and columns of zeros that are added on each side before each convolution."""

WEIGHTS_FILE = "letters.npz"


@dataclass(frozen=True, slots=True)
class ConvolutionLayer:
    """A convolution: `kernel` is (rows, columns, channels in, channels out), `bias` (channels out)."""

    kernel: Floats
    bias: Floats


class NetworkOutput(NamedTuple):
    """The output of the network for a strip.

    Attributes:
        log_probabilities: log probability of each class at each column, (32, 37), given that the strip is a
            plate.
        plate_log_odds: log odds that the strip is a plate.
    """

    log_probabilities: Floats
    plate_log_odds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LetterNet:
    """The network.

    Attributes:
        layers: the layers; the last one is linear and gives the classes.
        head: the hidden layer, and the linear layer that decides whether the strip is a plate.
        sharpness, trust: factors of the log probability of a text, and of its log prior; they calibrate the
            confidence of readings.
        facts: description of the training: seed, steps, fonts, accuracies.
    """

    layers: tuple[ConvolutionLayer, ...]
    head: tuple[ConvolutionLayer, ConvolutionLayer]
    sharpness: float
    trust: float
    facts: str

    def run(self, strip: Floats) -> NetworkOutput:
        """Run the network on a strip, (24, 64)."""
        x, plate_log_odds = strip[:, :, None], 0.0
        for i, (pad, pool) in enumerate(zip(PADS, POOLS, strict=True), 1):
            x = _pool(np.maximum(_convolve(x, self.layers[i - 1], pad), 0.0), pool)
            if i == HEAD_AFTER:
                hidden = np.maximum(_convolve(_pool(x, HEAD_POOL), self.head[0], (0, 0)), 0.0)
                plate_log_odds = float(_convolve(hidden, self.head[1], (0, 0))[0, 0, 0])
        scores = _convolve(x, self.layers[-1], (0, 0))[0]
        scores -= scores.max(axis=1, keepdims=True)
        normalized: Floats = scores - np.log(np.exp(scores).sum(axis=1, keepdims=True))
        return NetworkOutput(normalized, plate_log_odds)


@cache
def network() -> LetterNet:
    """Return the network with the weights of the package; their file is read once.

    Raises:
        ValueError: the file of weights does not fit this version.
    """
    with (
        resources.as_file(resources.files("colony.vision.letters") / WEIGHTS_FILE) as path,
        np.load(path) as stored,
    ):
        arrays = {name: stored[name] for name in stored.files}
    return unpacked(arrays)


def packed(net: LetterNet) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of a file of weights."""
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "sharpness": np.array(net.sharpness),
        "trust": np.array(net.trust),
        "facts": np.array(net.facts),
    }
    for i, layer in enumerate((*net.layers, *net.head)):
        scale = np.maximum(np.abs(layer.kernel).max(axis=(0, 1, 2)), 1e-12) / 127.0
        arrays[f"kernel{i}"] = np.rint(layer.kernel / scale).astype(np.int8)
        arrays[f"scale{i}"] = scale.astype(np.float32)
        arrays[f"bias{i}"] = layer.bias.astype(np.float32)
    return arrays


def unpacked(arrays: dict[str, npt.NDArray[np.generic]]) -> LetterNet:
    """Return the network whose weights are in these arrays.

    Raises:
        ValueError: an array is missing, or the layers do not fit together.
    """
    count = len(PADS) + 3
    names = [f"{kind}{i}" for i in range(count) for kind in ("kernel", "scale", "bias")]
    missing = [name for name in [*names, "sharpness", "trust", "facts"] if name not in arrays]
    if missing:
        hint = "train them again: python -m tools.training"
        raise ValueError(f"the weights in {WEIGHTS_FILE} lack {', '.join(missing)}; {hint}")
    layers = []
    for i in range(count):
        kernel = np.asarray(arrays[f"kernel{i}"], np.float32) * np.asarray(arrays[f"scale{i}"], np.float32)
        layers.append(ConvolutionLayer(kernel, np.asarray(arrays[f"bias{i}"], np.float32)))
    *trunk, hidden, last = layers
    _check_channels(trunk, [1, *(layer.kernel.shape[2] for layer in trunk[1:]), CLASSES])
    _check_channels([hidden, last], [trunk[HEAD_AFTER].kernel.shape[2], last.kernel.shape[2], 1])
    return LetterNet(
        layers=tuple(trunk),
        head=(hidden, last),
        sharpness=float(arrays["sharpness"][()]),
        trust=float(arrays["trust"][()]),
        facts=str(arrays["facts"][()]),
    )


def _check_channels(layers: Sequence[ConvolutionLayer], channels: Sequence[int]) -> None:
    """Raise ValueError unless the layers have these numbers of input and output channels."""
    found = [(layer.kernel.shape[2], layer.kernel.shape[3]) for layer in layers]
    if found != list(pairwise(channels)):
        raise ValueError(
            f"layers in {WEIGHTS_FILE} have {found} channels; expected {list(pairwise(channels))}"
        )


def _convolve(x: Floats, layer: ConvolutionLayer, pad: tuple[int, int]) -> Floats:
    """Return the convolution without strides, (rows, columns, channels)."""
    height, width, channels, out = layer.kernel.shape
    if pad != (0, 0):
        padded = np.zeros((x.shape[0] + 2 * pad[0], x.shape[1] + 2 * pad[1], channels), np.float32)
        padded[pad[0] : pad[0] + x.shape[0], pad[1] : pad[1] + x.shape[1]] = x
        x = padded
    rows, columns = x.shape[0] - height + 1, x.shape[1] - width + 1
    patches = np.lib.stride_tricks.as_strided(
        x, (rows, columns, height, width, channels), x.strides[:2] + x.strides, writeable=False
    )
    flat = patches.reshape(rows * columns, height * width * channels)
    result: Floats = (flat @ layer.kernel.reshape(-1, out) + layer.bias).reshape(rows, columns, out)
    return result


def _pool(x: Floats, pool: tuple[int, int]) -> Floats:
    """Return the maximum of each cell of `pool` rows and columns."""
    rows, columns, channels = x.shape
    height, width = pool
    if width > 1:
        x = x.reshape(rows, columns // width, width, channels).max(axis=2)
    if height > 1:
        x = x.reshape(rows // height, height, columns // width, channels).max(axis=1)
    return x


# --- prior --------------------------------------------------------------------------------------------
#
# The prior of the texts on door plates: the probability of each room number or word.
#
# Room numbers have one to five digits, perhaps with a letter before or after them. Some doors have words that
# are common to many buildings. The rest are arbitrary strings of letters, or of letters and digits. The prior
# does not list the rooms of any building; those of a map are given as a lexicon.

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


# --- decoding -----------------------------------------------------------------------------------------

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
