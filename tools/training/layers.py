"""The trainable layers of the network that reads characters, with forward and backward passes.

Arrays are (samples, rows, columns, channels), float32. A layer keeps what its backward pass needs from the
last forward pass.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]

_EPSILON = 1e-5
_MOMENTUM = 0.98
"""Fraction of the running mean and variance that remains after each batch."""


class Parameter:
    """Weights, and the gradient of the loss with respect to them."""

    def __init__(self, value: Floats) -> None:
        self.value = value
        self.gradient: Floats = np.zeros_like(value)


class TrainableLayer(Protocol):
    """A trainable layer."""

    def parameters(self) -> list[Parameter]:
        """Return the parameters that are learned."""
        ...

    def forward(self, x: Floats) -> Floats:
        """Return the output."""
        ...

    def backward(self, gradient: Floats) -> Floats:
        """Return the input's gradient for that of the output; store the parameters' gradients."""
        ...


class Convolution:
    """A convolution without strides, with zeros around its input.

    Args:
        size: rows and columns of the kernel.
        channels: numbers of input and output channels.
        pad: rows and columns of zeros on each side.
        random: generator of the initial weights.
        first: True to leave out the gradient with respect to its input, which is not needed.
        last: True for a bias, and small initial weights, so that all classes are about equally probable.
    """

    def __init__(
        self,
        size: tuple[int, int],
        channels: tuple[int, int],
        pad: tuple[int, int],
        random: np.random.Generator,
        *,
        first: bool = False,
        last: bool = False,
    ) -> None:
        shape = (*size, *channels)
        deviation = 0.01 if last else np.sqrt(2.0 / (size[0] * size[1] * channels[0]))
        self.kernel = Parameter(random.normal(0.0, deviation, shape).astype(np.float32))
        self.bias = Parameter(np.zeros(channels[1], np.float32)) if last else None
        self._first = first
        self._pad = pad
        self._flat: Floats = np.zeros((0, 0), np.float32)
        self._padded_shape: tuple[int, ...] = ()

    def parameters(self) -> list[Parameter]:
        """Return the kernel and the bias, if there is one."""
        return [self.kernel] if self.bias is None else [self.kernel, self.bias]

    def forward(self, x: Floats) -> Floats:
        """Return the convolution of a batch, (count, rows, columns, channels)."""
        height, width, channels, out = self.kernel.value.shape
        up, left = self._pad
        x = np.pad(x, ((0, 0), (up, up), (left, left), (0, 0)))
        self._padded_shape = x.shape
        count, rows, columns = x.shape[0], x.shape[1] - height + 1, x.shape[2] - width + 1
        strides = (*x.strides[:3], *x.strides[1:])
        patches = np.lib.stride_tricks.as_strided(x, (count, rows, columns, height, width, channels), strides)
        self._flat = patches.reshape(count * rows * columns, -1)
        y = self._flat @ self.kernel.value.reshape(-1, out)
        if self.bias is not None:
            y += self.bias.value
        return y.reshape(count, rows, columns, out)

    def backward(self, gradient: Floats) -> Floats:
        """Set the parameters' gradients, and return the gradient of the input."""
        height, width, channels, out = self.kernel.value.shape
        count, rows, columns = gradient.shape[:3]
        flat = gradient.reshape(-1, out)
        self.kernel.gradient = (self._flat.T @ flat).reshape(self.kernel.value.shape)
        if self.bias is not None:
            self.bias.gradient = flat.sum(axis=0)
        if self._first:
            return gradient
        patches = (flat @ self.kernel.value.reshape(-1, out).T).reshape(
            count, rows, columns, height, width, channels
        )
        padded = np.zeros(self._padded_shape, np.float32)
        for i in range(height):
            for j in range(width):
                padded[:, i : i + rows, j : j + columns] += patches[:, :, :, i, j]
        up, left = self._pad
        return padded[:, up : padded.shape[1] - up, left : padded.shape[2] - left]


class Normalization:
    """Batch normalization with a scale and a shift, then rectification."""

    def __init__(self, channels: int) -> None:
        self.scale = Parameter(np.ones(channels, np.float32))
        self.shift = Parameter(np.zeros(channels, np.float32))
        self.mean: Floats = np.zeros(channels, np.float32)
        self.variance: Floats = np.ones(channels, np.float32)
        self._normalized: Floats = np.zeros(0, np.float32)
        self._deviation: Floats = np.ones(channels, np.float32)
        self._positive: npt.NDArray[np.bool_] = np.zeros(0, bool)

    def parameters(self) -> list[Parameter]:
        """Return the scale and the shift."""
        return [self.scale, self.shift]

    def forward(self, x: Floats) -> Floats:
        """Return the normalized and rectified batch, and update the running mean and variance."""
        channels = x.shape[-1]
        mean = x.reshape(-1, channels).mean(axis=0)
        centered = x - mean
        flat = centered.reshape(-1, channels)
        variance = np.einsum("ij,ij->j", flat, flat) / np.float32(len(flat))
        self.mean = _MOMENTUM * self.mean + (1.0 - _MOMENTUM) * mean
        self.variance = _MOMENTUM * self.variance + (1.0 - _MOMENTUM) * variance
        self._deviation = np.sqrt(variance + np.float32(_EPSILON))
        self._normalized = centered / self._deviation
        y = self._normalized * self.scale.value + self.shift.value
        self._positive = y > 0.0
        rectified: Floats = np.maximum(y, 0.0)
        return rectified

    def backward(self, gradient: Floats) -> Floats:
        """Set the parameters' gradients, and return the gradient of the input."""
        gradient = gradient * self._positive
        flat, channels = gradient.reshape(-1, gradient.shape[-1]), gradient.shape[-1]
        self.scale.gradient = np.einsum("ij,ij->j", flat, self._normalized.reshape(-1, channels))
        self.shift.gradient = flat.sum(axis=0)
        count = np.float32(gradient.size / gradient.shape[-1])
        common = self.shift.gradient / count + self._normalized * (self.scale.gradient / count)
        result: Floats = (gradient - common) * (self.scale.value / self._deviation)
        return result

    def folded(self, kernel: Floats) -> tuple[Floats, Floats]:
        """Return the kernel and bias of a convolution equal to one with `kernel` followed by this."""
        factor = self.scale.value / np.sqrt(self.variance + np.float32(_EPSILON))
        return kernel * factor, self.shift.value - self.mean * factor


class Pooling:
    """Max pooling over cells of `size` rows and columns."""

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._is_maximum: npt.NDArray[np.bool_] = np.zeros(0, bool)

    def parameters(self) -> list[Parameter]:
        """Return nothing: pooling has no parameters."""
        return []

    def forward(self, x: Floats) -> Floats:
        """Return the maximum of each cell of a batch."""
        if self._size == (1, 1):
            return x
        count, rows, columns, channels = x.shape
        height, width = self._size
        cells = x.reshape(count, rows // height, height, columns // width, width, channels)
        y: Floats = cells.max(axis=(2, 4), keepdims=True)
        self._is_maximum = cells == y
        return y[:, :, 0, :, 0]

    def backward(self, gradient: Floats) -> Floats:
        """Return the gradient of the input."""
        if self._size == (1, 1):
            return gradient
        shared = gradient[:, :, None, :, None] * self._is_maximum
        count, rows, height, columns, width, channels = shared.shape
        result: Floats = shared.reshape(count, rows * height, columns * width, channels)
        return result
