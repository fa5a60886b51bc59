"""The network that reads characters: a small convolutional network.

Its input is a strip: the rectified image of a plate (`colony/vision/plates/strip.py`). For each of 32 columns
of the strip, it gives the probability of each character, and of no character. It has three convolutions of 3
by 3, each followed by rectification and the first two by pooling; then one over the whole height, one along
the columns, and a linear layer to the classes. Characters need only a small receptive field; a separate head,
a hidden layer over all columns, decides whether the whole strip is a plate. The weights are learned by
`python -m tools.training` and stored as 8-bit integers with a scale for each channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from colony.nav.maps.signs import CHARACTERS

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
class Layer:
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

    layers: tuple[Layer, ...]
    head: tuple[Layer, Layer]
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
        layers.append(Layer(kernel, np.asarray(arrays[f"bias{i}"], np.float32)))
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


def _check_channels(layers: Sequence[Layer], channels: Sequence[int]) -> None:
    """Raise ValueError unless the layers have these numbers of input and output channels."""
    found = [(layer.kernel.shape[2], layer.kernel.shape[3]) for layer in layers]
    if found != list(pairwise(channels)):
        raise ValueError(
            f"layers in {WEIGHTS_FILE} have {found} channels; expected {list(pairwise(channels))}"
        )


def _convolve(x: Floats, layer: Layer, pad: tuple[int, int]) -> Floats:
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
