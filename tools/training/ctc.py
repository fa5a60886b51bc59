"""The loss of connectionist temporal classification, and its gradient (Graves et al., ICML 2006).

The loss is the negative log probability of the correct texts, summed over all alignments to the columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from colony.vision.letters.decoding import states_of

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]

_IMPOSSIBLE = -1e30


def ctc_loss(scores: Floats, texts: Sequence[str]) -> tuple[float, Floats]:
    """Return the negative log probability of the texts, and its gradient with respect to the scores.

    Args:
        scores: scores of the classes before normalization, (samples, columns, classes).
        texts: one per sample, short enough for the columns.
    """
    count, columns, _ = scores.shape
    top = scores.max(axis=2, keepdims=True).astype(np.float64)
    logs = scores - top - np.log(np.exp(scores - top).sum(axis=2, keepdims=True))
    states, valid, skips = states_of(texts)
    emitted = np.take_along_axis(logs, np.broadcast_to(states[:, None], (count, columns, states.shape[1])), 2)
    emitted = np.where(valid[:, None], emitted, _IMPOSSIBLE)
    forward = _forward(emitted, skips)
    lengths = valid.sum(axis=1)
    backward = _backward(emitted, skips, lengths)
    samples = np.arange(count)
    last, rest = forward[samples, -1, lengths - 1], forward[samples, -1, np.maximum(lengths - 2, 0)]
    total = np.where(lengths > 1, np.logaddexp(last, rest), last)
    posteriors = np.exp(np.minimum(forward + backward - emitted - total[:, None, None], 0.0))
    posteriors = np.where(valid[:, None], posteriors, 0.0)
    target = np.zeros(scores.shape)
    rows, times = samples[:, None, None], np.arange(columns)[None, :, None]
    np.add.at(target, (rows, times, states[:, None]), posteriors)
    return float(-total.sum()), (np.exp(logs) - target).astype(np.float32)


def _forward(emitted: Doubles, skips: npt.NDArray[np.bool_]) -> Doubles:
    """Return the forward variables: log probabilities of the states and the emissions so far."""
    forward = np.full(emitted.shape, _IMPOSSIBLE)
    forward[:, 0, :2] = emitted[:, 0, :2]
    for t in range(1, emitted.shape[1]):
        log_p = forward[:, t - 1].copy()
        log_p[:, 1:] = np.logaddexp(log_p[:, 1:], forward[:, t - 1, :-1])
        skip = np.where(skips[:, 2:], forward[:, t - 1, :-2], _IMPOSSIBLE)
        log_p[:, 2:] = np.logaddexp(log_p[:, 2:], skip)
        forward[:, t] = np.maximum(log_p + emitted[:, t], _IMPOSSIBLE)
    return forward


def _backward(emitted: Doubles, skips: npt.NDArray[np.bool_], lengths: npt.NDArray[np.intp]) -> Doubles:
    """Return the backward variables: log probabilities of the emissions from each state on."""
    backward = np.full(emitted.shape, _IMPOSSIBLE)
    samples = np.arange(len(lengths))
    for state in (lengths - 1, np.maximum(lengths - 2, 0)):
        backward[samples, -1, state] = emitted[samples, -1, state]
    for t in range(emitted.shape[1] - 2, -1, -1):
        log_p = backward[:, t + 1].copy()
        log_p[:, :-1] = np.logaddexp(log_p[:, :-1], backward[:, t + 1, 1:])
        skip = np.where(skips[:, 2:], backward[:, t + 1, 2:], _IMPOSSIBLE)
        log_p[:, :-2] = np.logaddexp(log_p[:, :-2], skip)
        backward[:, t] = np.maximum(log_p + emitted[:, t], _IMPOSSIBLE)
    return backward
