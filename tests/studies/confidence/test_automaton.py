"""The automaton of thesis section 6.3, against all that is printed there."""

from __future__ import annotations

import random
from fractions import Fraction
from math import prod
from typing import TypeVar

import pytest

from studies.confidence.automaton import ALL_ARCS, TABLE_6_5, Automaton, Event, powers_of
from studies.confidence.estimate import PUBLISHED
from studies.confidence.published_runs import PUBLISHED_RUNS

T = TypeVar("T", float, Fraction)

PRINTED: dict[str, list[list[float]]] = {
    "c": [[0, 0, 0.9620, 0], [0, 0, 0.9802, 0], [0, 0, 0.9620, 0], [0, 0, 0, 0]],
    "d": [[0, 0, 0, 0], [0, 0, 0, 0.9802], [0, 0, 0, 0.9620], [0, 0, 0, 0]],
    "l": [[0, 1.0, 0, 0], [0, 0, 0, 0], [0, 0.9451, 0, 0], [0, 0, 0, 0]],
}


Matrix = list[list[Fraction]]


def matrix(automaton: Automaton, symbol: str) -> Matrix:
    """P(symbol) of section 6.3: the probability of a transition, from a row's state to a column's."""

    def chance(state: str, to: str) -> Fraction:
        arc = automaton.arcs.get((state, symbol))  # type: ignore[call-overload]
        if arc is None or arc.target != to:
            return Fraction(0)
        return prod((automaton.events[event] for event in arc.events), start=Fraction(1))

    return [[chance(state, to) for to in "SFCG"] for state in "SFCG"]


def times(row: list[T], by: list[list[T]]) -> list[T]:
    return [sum(row[i] * by[i][j] for i in range(4)) for j in range(4)]


@pytest.mark.parametrize("symbol", PRINTED)
def test_the_matrices_are_the_printed_ones(symbol: str) -> None:
    rounded = [[round(float(p), 4) for p in row] for row in matrix(PUBLISHED, symbol)]
    assert rounded == PRINTED[symbol]


def test_the_probabilities_are_the_printed_fractions() -> None:
    p5 = matrix(PUBLISHED, "l")[2][1]
    assert p5 == Fraction(76, 79) * Fraction(56, 57) == Fraction(4256, 4503)
    assert PUBLISHED.events[Event.LIGHTS] == Fraction(99, 101)
    # paths that pass none of the corridors G, N and J, in which two of the three corners failed
    without_trouble = Automaton(events={**PUBLISHED.events, Event.CORNER: Fraction(78, 79)})
    assert round(float(matrix(without_trouble, "c")[2][2]), 4) == 0.9873
    assert round(float(matrix(without_trouble, "l")[2][1]), 2) == 0.97


def test_they_are_those_of_the_published_runs() -> None:
    total = sum(run.required[0] for run in PUBLISHED_RUNS)
    failed = sum(run.failed_mode == "l" for run in PUBLISHED_RUNS)
    assert Fraction(total - failed, total) == PUBLISHED.events[Event.LIGHTS]
    corners = sum(run.completed[1] for run in PUBLISHED_RUNS)
    failed = sum(run.failed_mode == "c" for run in PUBLISHED_RUNS)
    assert Fraction(corners - failed, corners) == PUBLISHED.events[Event.CORNER]


@pytest.mark.parametrize(
    ("modes", "exact"),
    [
        ("ld", 0.9802),
        ("lclcld", 0.8412),
        ("clclcclccd", 0.6809),
        ("lclclcclcclclclclcd", 0.5110),
    ],
)
def test_the_confidences_of_table_6_5(modes: str, exact: float) -> None:
    """With the rounded probabilities of the thesis to the last digit; the first by its own matrices."""
    row = [1.0, 0.0, 0.0, 0.0]
    for symbol in modes:
        row = times(row, PRINTED[symbol])
    assert round(row[3], 4) == exact
    assert float(PUBLISHED.confidence(modes) or 0) == pytest.approx(exact, abs=3e-4)
    printed = next(row.confidence for row in TABLE_6_5 if row.modes == modes)
    assert printed == (0.962 if modes == "ld" else exact)


def test_the_printed_products() -> None:
    p2, p3, p5 = Fraction(99, 101), Fraction(76, 79), Fraction(4256, 4503)
    assert PUBLISHED.confidence("lclcld") == p2**3 * p5**2
    assert PUBLISHED.confidence("clclcclccd") == p3**4 * p5**3 * p2**3
    assert PUBLISHED.confidence("lclclcclcclclclclcd") == p5**7 * p2**8 * p3**3


def test_the_product_of_the_matrices_is_the_same() -> None:
    rng = random.Random(1)
    for _ in range(300):
        modes = "".join(rng.choice("cdl") for _ in range(rng.randint(1, 9)))
        row = [Fraction(1), Fraction(0), Fraction(0), Fraction(0)]
        for symbol in modes:
            row = times(row, matrix(PUBLISHED, symbol))
        assert row[3] == (PUBLISHED.confidence(modes) or 0), modes


def test_strings_that_the_automaton_does_not_know() -> None:
    for modes in ("", "v", "vv", "l", "lc", "dl", "ll", "x", "ldd", "d"):
        assert PUBLISHED.confidence(modes) is None, modes
    extended = Automaton(events=PUBLISHED.events, arcs=ALL_ARCS)
    assert extended.confidence("d") == 1
    assert extended.confidence("dd") is None


def test_behind_an_elevator_it_begins_anew() -> None:
    once = PUBLISHED.confidence("lclcld") or Fraction(0)
    assert PUBLISHED.confidence("lclcldvld") == once * Fraction(99, 101)
    assert PUBLISHED.confidence("vld") == PUBLISHED.confidence("ldv") == Fraction(99, 101)


def test_powers_count_what_must_come_true() -> None:
    powers = powers_of("lclcd")
    assert powers is not None
    assert dict(powers) == {
        Event.START_LIGHT: 1,
        Event.LIGHTS: 2,
        Event.CORNER: 2,
        Event.CORNER_LIGHT: 1,
        Event.DEAD_RECKONING: 1,
    }
