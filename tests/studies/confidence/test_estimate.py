"""The automaton from results of runs, and how certain it is."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from studies.confidence.automaton import PUBLISHED_ARCS, Event
from studies.confidence.estimate import (
    PUBLISHED,
    PUBLISHED_COUNTS,
    Count,
    RunOutcome,
    clopper_pearson,
    counts_of,
    estimate_automaton,
    regularized_beta,
    string_interval,
    wilson,
)


def test_each_mode_that_was_entered_is_a_trial() -> None:
    counts = counts_of(
        [
            RunOutcome(modes="lcld", completed=4),
            RunOutcome(modes="lcld", completed=2, first_light_found=True),  # lost along the second lights
            RunOutcome(modes="lcld", completed=2),  # the first of them was not found
            RunOutcome(modes="lcld", completed=1),  # lost in the corner
            RunOutcome(modes="ld", completed=0),
            RunOutcome(modes="ccd", completed=2),
        ]
    )
    assert counts == {
        Event.START_LIGHT: Count(4, 5),
        Event.LIGHTS: Count(5, 6),
        Event.CORNER: Count(5, 6),
        Event.CORNER_LIGHT: Count(2, 3),
        Event.DEAD_RECKONING: Count(1, 2),
    }


def test_more_modes_than_there_are_cannot_be_completed() -> None:
    with pytest.raises(ValueError, match="a run completed 3 modes of `ld`"):
        counts_of([RunOutcome(modes="ld", completed=3)])


def test_the_published_counts_make_the_published_automaton() -> None:
    assert estimate_automaton(PUBLISHED_COUNTS).events == PUBLISHED.events
    assert PUBLISHED.arcs == PUBLISHED_ARCS
    fractions = (Fraction(1), Fraction(99, 101), Fraction(76, 79), Fraction(56, 57), Fraction(1))
    assert tuple(PUBLISHED.events[event] for event in Event) == fractions


def test_what_was_never_tried_counts_as_sure() -> None:
    assert estimate_automaton(counts_of([])).confidence("ld") == 1


def test_runs_drawn_from_the_automaton_give_it_back() -> None:
    random = np.random.default_rng(7)
    modes = "lclcclcd"
    chances = {"l": 0.93, "c": 0.9, "d": 0.97}
    runs = []
    for _ in range(4000):
        completed, found = 0, True
        for mode in modes:
            found = mode != "l" or random.random() < 0.95
            if not found or random.random() >= chances[mode]:
                break
            completed += 1
        runs.append(RunOutcome(modes=modes, completed=completed, first_light_found=found))
    counts = counts_of(runs)
    reached = sum(run.completed == len(modes) for run in runs) / len(runs)
    assert float(estimate_automaton(counts).confidence(modes) or 0) == pytest.approx(reached, abs=0.03)
    for event, truth in ((Event.LIGHTS, 0.93), (Event.CORNER, 0.9), (Event.CORNER_LIGHT, 0.95)):
        low, high = clopper_pearson(counts[event], level=0.999)
        assert low < truth < high, event


@pytest.mark.parametrize(
    ("good", "trials", "low", "high"),
    [
        # Brown, Cai and DasGupta 2001 and statsmodels' proportion_confint agree on these to all digits given.
        (99, 101, 0.9307, 0.9946),
        (0, 20, 0.0, 0.1611),
        (20, 20, 0.8389, 1.0),
        (8, 10, 0.4902, 0.9433),
    ],
)
def test_wilson(good: int, trials: int, low: float, high: float) -> None:
    assert wilson(Count(good, trials)) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(
    ("good", "trials"), [(0, 10), (10, 10), (1, 57), (99, 101), (76, 79), (990, 1000), (9_900, 10_000)]
)
def test_clopper_and_pearson_leave_half_a_tail_on_either_side(good: int, trials: int) -> None:
    low, high = clopper_pearson(Count(good, trials))
    if good > 0:
        assert binomial_tail(trials, low, range(good, trials + 1)) == pytest.approx(0.025, rel=1e-6)
    if good < trials:
        assert binomial_tail(trials, high, range(good + 1)) == pytest.approx(0.025, rel=1e-6)
    assert (low == 0.0) == (good == 0)
    assert (high == 1.0) == (good == trials)


def binomial_tail(n: int, p: float, outcomes: range) -> float:
    def log_chance(k: int) -> float:
        choices = math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
        return choices + k * math.log(p) + (n - k) * math.log1p(-p)

    return math.fsum(math.exp(log_chance(k)) for k in outcomes)


def test_what_was_never_tried_may_be_anything() -> None:
    assert wilson(Count(0, 0)) == clopper_pearson(Count(0, 0)) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("a", "b", "x"), [(2, 3, 0.4), (5, 1, 0.9), (1, 1, 0.3), (3, 7, 0.02), (7, 2, 0.999)]
)
def test_the_regularized_beta_function_is_a_binomial_tail(a: int, b: int, x: float) -> None:
    n = a + b - 1
    assert regularized_beta(a, b, x) == pytest.approx(binomial_tail(n, x, range(a, n + 1)), rel=1e-9)


def test_the_interval_of_a_string_holds_its_confidence() -> None:
    for modes in ("ld", "lclcld", "clclcclccd", "lclclcclcclclclclcd"):
        low, high = string_interval(PUBLISHED_COUNTS, modes, seed=1) or (1.0, 0.0)
        assert low < float(PUBLISHED.confidence(modes) or 0) < high, modes
    assert string_interval(PUBLISHED_COUNTS, "ll", seed=1) is None


def test_an_interval_is_a_matter_of_its_seed_and_narrows_with_more_runs() -> None:
    wide = string_interval(PUBLISHED_COUNTS, "lcld", seed=3)
    assert wide == string_interval(PUBLISHED_COUNTS, "lcld", seed=3)
    assert wide != string_interval(PUBLISHED_COUNTS, "lcld", seed=4)
    more = {
        event: Count(count.successes * 100, count.trials * 100) for event, count in PUBLISHED_COUNTS.items()
    }
    narrow = string_interval(more, "lcld", seed=3)
    assert narrow.high - narrow.low < 0.2 * (wide.high - wide.low)


def test_an_interval_covers_the_truth_as_often_as_it_says() -> None:
    """500 experiments of 40 runs each, with a confidence of 0.9 * 0.95, and 95 % intervals."""
    random = np.random.default_rng(11)
    truth = 0.9 * 0.95
    held = 0
    for seed in range(500):
        counts = dict.fromkeys(Event, Count(1000, 1000)) | {
            Event.LIGHTS: Count(int(random.binomial(40, 0.9)), 40),
            Event.DEAD_RECKONING: Count(int(random.binomial(40, 0.95)), 40),
        }
        low, high = string_interval(counts, "ld", seed=seed, draws=1000) or (1.0, 0.0)
        held += low <= truth <= high
    assert 0.92 * 500 <= held <= 0.99 * 500


def test_the_interval_of_what_never_failed_reaches_its_estimate() -> None:
    sure = {event: Count(40, 40) for event in Event}
    interval = string_interval(sure, "lclcld", seed=1)
    assert interval.high == 1.0
    assert 0.7 < interval.low < 0.99
    assert string_interval({**sure, Event.CORNER: Count(39, 40)}, "ld", seed=1) == string_interval(
        sure, "ld", seed=1
    )
