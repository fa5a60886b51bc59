"""Texts from the classes of columns, against a count of all ways to write them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from colony.nav.maps.signs import CHARACTERS
from colony.vision.letters.decoding import (
    ARBITRARY_FRACTION,
    BLANK,
    CLASSES,
    SHAPES,
    WORD_FRACTION,
    likely_texts,
    log_prior,
    log_probabilities_of,
)


def _columns(rows: list[dict[str, float]]) -> np.ndarray:
    """Log probabilities of columns in which only these characters are, "" being the blank."""
    table = np.full((len(rows), CLASSES), 1e-12)
    for i, row in enumerate(rows):
        for character, probability in row.items():
            table[i, CHARACTERS.index(character) if character else BLANK] = probability
    return np.log(table).astype(np.float32)


def _counted(rows: list[dict[str, float]]) -> dict[str, float]:
    """The probabilities of all texts, by all ways to write them."""
    texts: dict[str, float] = {}
    for way in itertools.product(*[row.items() for row in rows]):
        path = [character for character, _ in way]
        text = "".join(c for i, c in enumerate(path) if c and (i == 0 or path[i - 1] != c))
        texts[text] = texts.get(text, 0.0) + math.prod(p for _, p in way)
    return texts


ROWS = [
    {"": 0.6, "1": 0.4},
    {"": 0.2, "1": 0.5, "7": 0.3},
    {"": 0.7, "1": 0.2, "7": 0.1},
    {"": 0.3, "1": 0.7},
    {"": 0.5, "8": 0.3, "B": 0.2},
]


def test_probabilities_of_texts_are_sums_over_all_ways() -> None:
    counted = _counted(ROWS)
    table = _columns(ROWS)
    found = np.exp(log_probabilities_of(list(counted), table))
    assert len(counted) > 20
    np.testing.assert_allclose(found, list(counted.values()), rtol=1e-4)


def test_the_search_finds_the_most_probable_texts() -> None:
    counted, found = _counted(ROWS), likely_texts(_columns(ROWS))
    best = sorted(counted, key=lambda text: -counted[text])[:4]
    for text in best:
        assert found[text] == pytest.approx(counted[text], rel=1e-3)
    assert max(found, key=lambda text: found[text]) == best[0]


def test_equal_neighbors_need_a_blank_between_them() -> None:
    table = _columns([{"1": 1.0}, {"1": 1.0}, {"": 1.0}, {"1": 1.0}])
    assert max(likely_texts(table).items(), key=lambda entry: entry[1])[0] == "11"


def test_a_text_longer_than_the_columns_is_impossible() -> None:
    table = np.log(np.full((2, CLASSES), 1.0 / CLASSES)).astype(np.float32)
    found = log_probabilities_of(["11", "12", ""], table)
    assert found[0] == -math.inf
    assert found[1:].tolist() == pytest.approx([-2.0 * math.log(CLASSES)] * 2)


def test_no_texts_have_no_probabilities() -> None:
    assert log_probabilities_of([], _columns(ROWS)).shape == (0,)


def test_no_text_is_longer_than_a_plate() -> None:
    table = _columns([{c: 1.0} for c in "1234567"])
    assert all(len(text) <= 5 for text in likely_texts(table))


def test_room_numbers_are_more_probable_than_what_looks_like_them() -> None:
    for room, other in (("340", "34O"), ("118", "1I8"), ("B12", "BI2"), ("MEN", "M3N"), ("STAIR", "5TAIR")):
        assert log_prior(room) > log_prior(other)


def test_a_lexicon_favors_its_texts() -> None:
    assert log_prior("340", ["340", "342"]) > log_prior("340")
    assert log_prior("346", ["340", "342"]) < log_prior("346")


def test_shares_of_texts_add_up() -> None:
    assert sum(SHAPES.values()) + WORD_FRACTION + ARBITRARY_FRACTION == pytest.approx(1.0)
