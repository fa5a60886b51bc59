"""The network during training, and its training steps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from colony.vision.letters.decoding import (
    CLASSES,
    FRAMES,
    HEAD_AFTER,
    HEAD_POOL,
    PADS,
    POOLS,
    ConvolutionLayer,
    LetterNet,
)
from tools.training.ctc import ctc_loss
from tools.training.layers import Convolution, Normalization, Parameter, Pooling, TrainableLayer
from tools.training.samples import Batch, batch

Floats = npt.NDArray[np.float32]

CHANNELS = (16, 40, 56, 112, 112)
SIZES = ((3, 3), (3, 3), (3, 3), (6, 3), (1, 3))
"""Sizes of the convolutions before the last layer: rows and columns of their kernels."""

HIDDEN = 32
"""Channels of the hidden layer of the head."""

BATCH_SIZE = 64
LEARNING_RATE = 3e-3

_WARMUP_STEPS = 100
_FIRST_DECAY, _SECOND_DECAY, _EPSILON = 0.9, 0.99, 1e-8
_MAX_GRADIENT_NORM = 5.0


class _Stage(NamedTuple):
    """A convolution, its normalization and its pooling."""

    convolution: Convolution
    normalization: Normalization
    pooling: Pooling

    def forward(self, x: Floats) -> Floats:
        for layer in self:
            x = layer.forward(x)
        return x

    def backward(self, gradient: Floats) -> Floats:
        for layer in reversed(self):
            gradient = layer.backward(gradient)
        return gradient

    def folded(self) -> ConvolutionLayer:
        """Return the equivalent convolution with a bias, without the pooling."""
        return ConvolutionLayer(*self.normalization.folded(self.convolution.kernel.value))


class Learner:
    """The layers of the network, initially random, with Adam's moments of their gradients."""

    def __init__(self, random: np.random.Generator) -> None:
        self._stages: list[_Stage] = []
        before = 1
        for size, channels, pad, pool in zip(SIZES, CHANNELS, PADS, POOLS, strict=True):
            convolution = Convolution(size, (before, channels), pad, random, first=before == 1)
            self._stages.append(_Stage(convolution, Normalization(channels), Pooling(pool)))
            before = channels
        self._last = Convolution((1, 1), (before, CLASSES), (0, 0), random, last=True)
        cells = FRAMES // HEAD_POOL[1]
        hidden = Convolution((1, cells), (CHANNELS[HEAD_AFTER - 1], HIDDEN), (0, 0), random)
        self._head_pool = Pooling(HEAD_POOL)
        self._head = _Stage(hidden, Normalization(HIDDEN), Pooling((1, 1)))
        self._head_last = Convolution((1, 1), (HIDDEN, 1), (0, 0), random, last=True)
        stages = [layer for stage in (*self._stages, self._head) for layer in stage]
        layers: list[TrainableLayer] = [*stages, self._last, self._head_last]
        self._parameters = [p for layer in layers for p in layer.parameters()]
        self._moments = [(np.zeros_like(p.value), np.zeros_like(p.value)) for p in self._parameters]
        self._steps = 0

    def step(self, samples: Batch, rate: float) -> float:
        """Make a training step on a batch; return the mean loss before the step."""
        x = samples.strips[..., None]
        for i, stage in enumerate(self._stages, 1):
            x = stage.forward(x)
            if i == HEAD_AFTER:
                common = x
        scores = self._last.forward(x)
        plates = self._head_last.forward(self._head.forward(self._head_pool.forward(common)))
        loss, score_gradient, plate_gradient = _loss(scores[:, 0], plates[:, 0, 0, 0], samples.texts)
        common_gradient = self._head.backward(self._head_last.backward(plate_gradient[:, None, None, None]))
        common_gradient = self._head_pool.backward(common_gradient)
        gradient = self._last.backward(score_gradient[:, None])
        for i, stage in reversed(list(enumerate(self._stages, 1))):
            gradient = stage.backward(gradient + common_gradient if i == HEAD_AFTER else gradient)
        self._descend(rate)
        return loss

    def network(self) -> LetterNet:
        """Return the network as trained so far, not yet calibrated."""
        trunk = (*(stage.folded() for stage in self._stages), _linear(self._last))
        head = (self._head.folded(), _linear(self._head_last))
        return LetterNet(layers=trunk, head=head, sharpness=1.0, trust=1.0, facts="")

    def _descend(self, rate: float) -> None:
        """Make a step of Adam (Kingma and Ba, ICLR 2015), with gradient clipping."""
        self._steps += 1
        norm = math.sqrt(sum(float(np.vdot(p.gradient, p.gradient)) for p in self._parameters))
        factor = min(1.0, _MAX_GRADIENT_NORM / max(norm, 1e-12))
        first_correction = 1.0 - _FIRST_DECAY**self._steps
        second_correction = 1.0 - _SECOND_DECAY**self._steps
        for parameter, (first, second) in zip(self._parameters, self._moments, strict=True):
            gradient = parameter.gradient * np.float32(factor)
            first += (1.0 - _FIRST_DECAY) * (gradient - first)
            second += (1.0 - _SECOND_DECAY) * (gradient * gradient - second)
            _update(parameter, first / first_correction, second / second_correction, rate)


def train_steps(
    learner: Learner, steps: int, fonts: Sequence[Path], random: np.random.Generator
) -> Iterator[float]:
    """Train on new samples at each step, and yield its loss; the learning rate falls to zero."""
    for i in range(steps):
        decay = 0.5 * (1.0 + math.cos(math.pi * i / steps))
        yield learner.step(
            batch(BATCH_SIZE, fonts, random), LEARNING_RATE * decay * min(1.0, (i + 1) / _WARMUP_STEPS)
        )


def _loss(scores: Floats, plates: Floats, texts: Sequence[str]) -> tuple[float, Floats, Floats]:
    """Return the mean loss, and its gradients with respect to the class scores and the plate's log odds.

    Only plates contribute to the loss of the characters, as other samples have none.
    """
    is_plate = np.array([bool(text) for text in texts])
    score_gradient = np.zeros_like(scores)
    loss = 0.0
    if is_plate.any():
        loss, score_gradient[is_plate] = ctc_loss(scores[is_plate], [text for text in texts if text])
    signs = np.where(is_plate, 1.0, -1.0)
    wrong = 1.0 / (1.0 + np.exp(signs * plates.astype(np.float64)))
    loss += float(np.logaddexp(0.0, -signs * plates).sum())
    plate_gradient = (-signs * wrong).astype(np.float32)
    count = np.float32(len(texts))
    return loss / len(texts), score_gradient / count, plate_gradient / count


def _linear(layer: Convolution) -> ConvolutionLayer:
    assert layer.bias is not None, "a last layer has a bias"
    return ConvolutionLayer(layer.kernel.value.copy(), layer.bias.value.copy())


def _update(parameter: Parameter, first: Floats, second: Floats, rate: float) -> None:
    parameter.value -= (rate * first / (np.sqrt(second) + _EPSILON)).astype(np.float32)
