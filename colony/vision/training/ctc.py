"""The loss of connectionist temporal classification, and its gradient (Graves et al., ICML 2006).

The loss is the negative log probability of the right texts, over all their alignments to the columns.
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
    states, valid, leaps = states_of(texts)
    emitted = np.take_along_axis(logs, np.broadcast_to(states[:, None], (count, columns, states.shape[1])), 2)
    emitted = np.where(valid[:, None], emitted, _IMPOSSIBLE)
    ahead = _ahead(emitted, leaps)
    lengths = valid.sum(axis=1)
    behind = _behind(emitted, leaps, lengths)
    each = np.arange(count)
    last, rest = ahead[each, -1, lengths - 1], ahead[each, -1, np.maximum(lengths - 2, 0)]
    total = np.where(lengths > 1, np.logaddexp(last, rest), last)
    shares = np.exp(np.minimum(ahead + behind - emitted - total[:, None, None], 0.0))
    shares = np.where(valid[:, None], shares, 0.0)
    wanted = np.zeros(scores.shape)
    rows, times = each[:, None, None], np.arange(columns)[None, :, None]
    np.add.at(wanted, (rows, times, states[:, None]), shares)
    return float(-total.sum()), (np.exp(logs) - wanted).astype(np.float32)


def _ahead(emitted: Doubles, leaps: npt.NDArray[np.bool_]) -> Doubles:
    """Return the forward variables: log probabilities of the states, with the emissions so far."""
    ahead = np.full(emitted.shape, _IMPOSSIBLE)
    ahead[:, 0, :2] = emitted[:, 0, :2]
    for t in range(1, emitted.shape[1]):
        at = ahead[:, t - 1].copy()
        at[:, 1:] = np.logaddexp(at[:, 1:], ahead[:, t - 1, :-1])
        leap = np.where(leaps[:, 2:], ahead[:, t - 1, :-2], _IMPOSSIBLE)
        at[:, 2:] = np.logaddexp(at[:, 2:], leap)
        ahead[:, t] = np.maximum(at + emitted[:, t], _IMPOSSIBLE)
    return ahead


def _behind(emitted: Doubles, leaps: npt.NDArray[np.bool_], lengths: npt.NDArray[np.intp]) -> Doubles:
    """Return the backward variables: log probabilities of the emissions from each state on."""
    behind = np.full(emitted.shape, _IMPOSSIBLE)
    each = np.arange(len(lengths))
    for state in (lengths - 1, np.maximum(lengths - 2, 0)):
        behind[each, -1, state] = emitted[each, -1, state]
    for t in range(emitted.shape[1] - 2, -1, -1):
        at = behind[:, t + 1].copy()
        at[:, :-1] = np.logaddexp(at[:, :-1], behind[:, t + 1, 1:])
        leap = np.where(leaps[:, 2:], behind[:, t + 1, 2:], _IMPOSSIBLE)
        at[:, :-2] = np.logaddexp(at[:, :-2], leap)
        behind[:, t] = np.maximum(at + emitted[:, t], _IMPOSSIBLE)
    return behind
