"""Statistics of many runs: rates with their intervals, percentiles, and the comparison with targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.confidence.automaton import RIDE
from studies.confidence.estimate import Count, clopper_pearson, wilson
from studies.confidence.published_runs import PUBLISHED_RUNS, Wing
from studies.record import RunResult

MM_S_TO_M_MIN = 0.06


def percentile(values: Sequence[float], fraction: float) -> float:
    """Return the quantile `fraction` (0 to 1) of the values, interpolated linearly; NaN without values."""
    return float(np.quantile(values, fraction)) if values else math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A measured quantity (`what`), its value (`found`), the promised value, and True if that is met."""

    what: str
    found: str
    promised: str
    met: bool


WINGS: tuple[Wing, ...] = ("old", "new")

NONE_REACHED = "no run reached its goal"

TOP_MM_S = 500.0

CONTACT_MM_S = 50.0
"""Maximum speed of a harmless contact."""


def targets(results: Sequence[RunResult], *, published: bool) -> tuple[Target, ...]:
    """Compare results with the promised values.

    Args:
        results: the results.
        published: True for the published runs, which have a wing each; False for a user's list.
    """
    if not results:
        return ()
    rides = all(RIDE in r.planned_modes for r in results)
    found = [_missions(results, 0.98) if rides else _reached(results, 0.99 if published else 0.95)]
    if published:
        found.append(_worst_run(results))
    found.append(_goal_distance("along the corridor", [abs(r.overshoot_mm) for r in results if r.reached]))
    found.append(_goal_distance("as the crow flies", [r.goal_error_mm for r in results if r.reached]))
    if published:
        speeds = {"old": 17.9, "new": 10.3}
        found += [_mean_speed(results, wing, speeds[wing]) for wing in WINGS if _of_wing(results, wing)]
    found.append(_top_speed(results))
    return (*found, _hard_contacts(results))


def wing_of(result: RunResult) -> Wing:
    """Return the wing of a published run."""
    return PUBLISHED_RUNS[result.key.number - 1].wing


def _reached(results: Sequence[RunResult], promised: float) -> Target:
    reached = sum(r.reached for r in results)
    return _rate("runs that reached the goal", reached, len(results), promised)


def _missions(results: Sequence[RunResult], promised: float) -> Target:
    """Return the target of runs to other floors; runs that collide with doors do not count."""
    good = sum(r.reached and r.contacts.fastest_mm_s <= CONTACT_MM_S for r in results)
    what = f"runs that reached the goal on its floor, with no contact above {CONTACT_MM_S:g} mm/s"
    return _rate(what, good, len(results), promised)


def _rate(what: str, good: int, count: int, promised: float) -> Target:
    low, high = wilson(Count(good, count))
    interval = f"95 % interval {100 * low:.1f} to {100 * high:.1f} %"
    return Target(
        what=what,
        found=f"{good} of {count}, {percent(good, count)} ({interval})",
        promised=f"at least {100 * promised:g} %",
        met=good >= promised * count,
    )


def _worst_run(results: Sequence[RunResult]) -> Target:
    reached_by_run: dict[int, list[bool]] = {}
    for result in results:
        reached_by_run.setdefault(result.key.number, []).append(result.reached)
    number = min(reached_by_run, key=lambda n: (sum(reached_by_run[n]) / len(reached_by_run[n]), n))
    reached, count = sum(reached_by_run[number]), len(reached_by_run[number])
    return Target(
        what="the worst of the runs",
        found=f"run {number}: {reached} of {count}, {percent(reached, count)}",
        promised="at least 90 %",
        met=reached >= 0.9 * count,
    )


def _of_wing(results: Sequence[RunResult], wing: Wing) -> list[RunResult]:
    return [result for result in results if wing_of(result) == wing]


def _goal_distance(direction: str, distances: Sequence[float]) -> Target:
    found = percentile(distances, 0.95)
    return Target(
        what=f"distance to the goal {direction}, 95th percentile",
        found=f"{found / 1000:.3f} m" if distances else NONE_REACHED,
        promised="at most 0.3 m",
        met=found <= 300.0,
    )


def _mean_speed(results: Sequence[RunResult], wing: Wing, promised: float) -> Target:
    speeds = [r.mean_mm_s * MM_S_TO_M_MIN for r in _of_wing(results, wing) if r.reached]
    what, promised_text = f"mean speed, {wing} wing", f"at least {promised:g} m/min"
    if not speeds:
        return Target(what=what, found=NONE_REACHED, promised=promised_text, met=False)
    mean = sum(speeds) / len(speeds)
    return Target(
        what=what,
        found=f"{mean:.1f} m/min (slowest {min(speeds):.1f}, fastest {max(speeds):.1f})",
        promised=promised_text,
        met=mean >= promised,
    )


def _top_speed(results: Sequence[RunResult]) -> Target:
    slowest, fastest = min(r.top_mm_s for r in results), max(r.top_mm_s for r in results)
    return Target(
        what="top speed of a run",
        found=f"{slowest / 1000:.2f} to {fastest / 1000:.2f} m/s",
        promised=f"{TOP_MM_S / 1000:g} m/s",
        met=fastest >= 0.99 * TOP_MM_S,
    )


def _hard_contacts(results: Sequence[RunResult]) -> Target:
    hard = [r for r in results if r.contacts.fastest_mm_s > CONTACT_MM_S]
    touched = sum(r.contacts.number for r in results)
    fastest = max((r.contacts.fastest_mm_s for r in results), default=0.0)
    return Target(
        what=f"runs with a contact above {CONTACT_MM_S:g} mm/s",
        found=f"{len(hard)} (contacts in all: {touched}, the fastest at {fastest:.0f} mm/s)",
        promised="none",
        met=not hard,
    )


def percent(count: int, total: int) -> str:
    """Format a rate for people."""
    return f"{100 * count / total:.1f} %" if total else "none"


def rate(count: Count) -> str:
    """Format a rate with its exact 95 % interval (Clopper and Pearson), for people."""
    if count.trials == 0:
        return "none"
    low, high = clopper_pearson(count)
    frequency = count.successes / count.trials
    return f"{count.successes} of {count.trials}, {frequency:.4f} ({low:.4f} to {high:.4f})"
