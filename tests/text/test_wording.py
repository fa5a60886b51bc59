"""Numbers, times and lists as sentences have them."""

from __future__ import annotations

import doctest

import pytest

from colony.text import wording
from colony.text.wording import counted, duration_text, listed, quoted, seconds_of, time_text

MS = 1_000_000


def test_the_examples_of_the_docstrings() -> None:
    assert doctest.testmod(wording) == (0, 10)


@pytest.mark.parametrize(
    ("ns", "text"),
    [
        (1_500 * MS, "1.5 s"),
        (60_000 * MS, "60 s"),
        (250 * MS, "250 ms"),
        (1, "0.000001 ms"),
        (1_000_000_001, "1.000000001 s"),
        (0, "0 ms"),
        (1_000_000, "1 ms"),
        (10_000_000, "10 ms"),
        (999_999_999, "999.999999 ms"),
        (1_000_000_000, "1 s"),
        (10_000_000_000, "10 s"),
        (10_050_000_000, "10.05 s"),
        (100_500_000, "100.5 ms"),
    ],
)
def test_durations(ns: int, text: str) -> None:
    assert duration_text(ns) == text


def test_only_one_is_singular() -> None:
    assert [counted(n, "frame") for n in (0, 1, 2)] == ["0 frames", "1 frame", "2 frames"]


@pytest.mark.parametrize(
    ("words", "text"), [((), ""), (("a",), "a"), (("a", "b"), "a and b"), (("a", "b", "c"), "a, b and c")]
)
def test_lists(words: tuple[str, ...], text: str) -> None:
    assert listed(words) == text


def test_names_are_quoted() -> None:
    assert quoted(["a", "b"], "or") == "`a` or `b`"


@pytest.mark.parametrize(
    ("t_ns", "text"),
    [
        (9_849_999_999, "9.85 s"),
        (9_850_000_001, "9.85 s"),
        (-1, "0 s"),
        (12_345_678_912_345, "12345.6789 s"),
        (50_000_000, "0.05 s"),
    ],
)
def test_times_have_no_digits_of_a_clocks_jitter(t_ns: int, text: str) -> None:
    assert time_text(t_ns) == text
    assert seconds_of(t_ns) == float(text.removesuffix(" s"))
