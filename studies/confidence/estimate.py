"""Estimates of the automaton's probabilities from the results of runs, with their confidence intervals.

Each event is a Bernoulli trial with k successes in n trials. Intervals of one probability are those of Wilson
(1927), or the exact and wider ones of Clopper and Pearson (1934). The interval of a string's confidence comes
from drawing each event's probability from its posterior distribution under Jeffreys' prior, Beta(k + 1/2, n -
k + 1/2). Resampling the runs instead would make every event certain that never failed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from colony.experiment import report
from studies.confidence.automaton import ALL_ARCS, PUBLISHED_ARCS, Arcs, Automaton, Event, powers_of


class Count(NamedTuple):
    """The numbers of successes and of trials."""

    successes: int
    trials: int

    def plus(self, succeeded: bool) -> Count:
        """Return the count after one more trial."""
        return Count(self.successes + succeeded, self.trials + 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutcome:
    """The outcome of a run.

    Attributes:
        modes: the run's modes.
        completed: number of modes that it completed.
        first_light_found: for a run that failed along lights: True if it had found the first light.
    """

    modes: str
    completed: int
    first_light_found: bool = False


Counts = Mapping[Event, Count]


PUBLISHED_COUNTS: Counts = MappingProxyType(
    {
        Event.START_LIGHT: Count(100, 100),
        Event.LIGHTS: Count(99, 101),
        Event.CORNER: Count(76, 79),
        Event.CORNER_LIGHT: Count(56, 57),
        Event.DEAD_RECKONING: Count(35, 35),
    }
)
"""Counts of the thesis's runs: those of section 6.3, and those of the mode D in Tables 6.1 and 6.2."""


def counts_of(runs: Iterable[RunOutcome]) -> dict[Event, Count]:
    """Count the trials and successes of each event in these runs.

    Raises:
        ValueError: a run completed more modes than it has, or fewer than none.
    """
    counts = dict.fromkeys(Event, Count(0, 0))
    for run in runs:
        if not 0 <= run.completed <= len(run.modes):
            raise ValueError(f"a run completed {run.completed} modes of `{run.modes}`")
        previous_mode = ""
        for i, mode in enumerate(run.modes[: run.completed + 1]):
            completed = i < run.completed
            for event, succeeded in _events(
                mode, previous_mode, completed, completed or run.first_light_found
            ):
                counts[event] = counts[event].plus(succeeded)
            previous_mode = mode
    return counts


def _events(mode: str, previous_mode: str, completed: bool, light_found: bool) -> list[tuple[Event, bool]]:
    """Return the events of a mode after the previous one, each with True for a success."""
    match mode:
        case "l":
            first = Event.CORNER_LIGHT if previous_mode == "c" else Event.START_LIGHT
            return [(first, light_found), (Event.LIGHTS, completed)] if light_found else [(first, False)]
        case "c":
            return [(Event.CORNER, completed)]
        case "d":
            return [(Event.DEAD_RECKONING, completed)]
        case _:
            return []


def estimate_automaton(counts: Counts, arcs: Arcs = ALL_ARCS) -> Automaton:
    """Return the automaton whose probabilities are the relative frequencies; untried events are certain."""
    events = {
        event: Fraction(count.successes, count.trials) if count.trials else Fraction(1)
        for event, count in counts.items()
    }
    return Automaton(events=events, arcs=arcs)


PUBLISHED = estimate_automaton(PUBLISHED_COUNTS, PUBLISHED_ARCS)
"""Figure 6.7: of 101 runs of lights 2 failed, of 79 corners 3, and of 57 first lights behind a corner 1."""


class Interval(NamedTuple):
    """An interval of probabilities."""

    low: float
    high: float


def wilson(count: Count) -> Interval:
    """Return Wilson's score interval of 95 % for an event's probability; [0, 1] if it was never tried."""
    found = report.wilson(count.successes, count.trials)
    return Interval(found.low, found.high)


def clopper_pearson(count: Count, level: float = 0.95) -> Interval:
    """Return the exact interval: all probabilities for which both tails are at least (1 - `level`) / 2."""
    successes, n = count
    tail = (1 - level) / 2
    low = 0.0 if successes == 0 else _root(lambda p: regularized_beta(successes, n - successes + 1, p) - tail)
    high = (
        1.0
        if successes == n
        else _root(lambda p: regularized_beta(successes + 1, n - successes, p) - 1 + tail)
    )
    return Interval(low, high)


def string_interval(
    counts: Counts, modes: str, *, seed: int, level: float = 0.95, draws: int = 10_000, arcs: Arcs = ALL_ARCS
) -> Interval | None:
    """Return the interval of a string's confidence, or None if the automaton does not accept the string.

    Args:
        counts: counts of all events; events that the string does not require have no effect.
        modes: the string: the modes of a plan, in order.
        seed: seed of the draws.
        level: level of the interval.
        draws: number of draws for each event.
        arcs: the arcs of the automaton.
    """
    powers = powers_of(modes, arcs)
    if powers is None:
        return None
    logs = np.zeros(draws)
    for number, event in enumerate(Event):  # each has its own random stream, independent of the other events
        if powers[event]:
            successes, trials = counts[event]
            probabilities = np.random.default_rng((seed, number)).beta(
                successes + 0.5, trials - successes + 0.5, draws
            )
            logs += powers[event] * np.log(probabilities)
    if all(counts[event].successes == counts[event].trials for event in Event if powers[event]):
        # Nothing ever failed, so the estimate is 1: the interval reaches it (Brown, Cai and DasGupta 2001).
        return Interval(float(np.quantile(np.exp(logs), 1 - level)), 1.0)
    low, high = np.quantile(np.exp(logs), [(1 - level) / 2, (1 + level) / 2])
    return Interval(float(low), float(high))


_BISECTIONS = 60


def _root(increasing: Callable[[float], float]) -> float:
    """Return the root of an increasing function that is negative at 0 and positive at 1."""
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        mid = (low + high) / 2
        low, high = (mid, high) if increasing(mid) < 0.0 else (low, mid)
    return (low + high) / 2


_TINY = 1e-300
_MAX_TERMS = 10_000


def regularized_beta(a: float, b: float, x: float) -> float:
    """Return I_x(a, b), the distribution function of Beta(a, b), to about 1e-12.

    It is evaluated as a continued fraction (Abramowitz and Stegun 26.5.8) by Lentz's method.
    """
    if x <= 0.0 or x >= 1.0:
        return float(x >= 1.0)
    if x > (a + 1) / (a + b + 2):  # the fraction converges quickly on the other side
        return 1.0 - regularized_beta(b, a, 1.0 - x)
    front = math.exp(
        math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    )
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1) or _TINY)
    fraction = d
    for m in range(1, _MAX_TERMS):
        for numerator in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1.0 / (1.0 + numerator * d or _TINY)
            c = 1.0 + numerator / c or _TINY
            fraction *= c * d
        if abs(c * d - 1.0) < 1e-14:
            break
    return front * fraction / a
