"""The confidence automaton of thesis section 6.3, with probabilities estimated from results."""

from __future__ import annotations

from collections.abc import Sequence

from studies.confidence.automaton import TABLE_6_5
from studies.confidence.estimate import (
    PUBLISHED,
    Count,
    RunOutcome,
    clopper_pearson,
    counts_of,
    estimate_automaton,
    string_interval,
)
from studies.record import RunResult
from studies.tables import markdown


def run_modes(results: Sequence[RunResult]) -> list[RunOutcome]:
    """Return the modes of each run's plan, with the number of completed modes."""
    return [
        RunOutcome(
            modes=r.planned_modes,
            completed=len(r.planned_modes) if r.reached else min(r.completed, len(r.planned_modes) - 1),
            first_light_found=r.first_light,
        )
        for r in results
    ]


def event_table(results: Sequence[RunResult]) -> str:
    """Return the probability of each event, with its exact 95 % interval, beside the published one."""
    rows = []
    for event, (good, trials) in counts_of(run_modes(results)).items():
        if trials == 0:
            continue
        low, high = clopper_pearson(Count(good, trials))
        published = PUBLISHED.events[event]
        rows.append(
            [
                event.value,
                f"{good} of {trials}",
                f"{good / trials:.4f}",
                f"{low:.4f} to {high:.4f}",
                f"{float(published):.4f}",
            ]
        )
    return markdown(["event", "seen", "probability", "95 % interval", "published"], rows)


def path_table(results: Sequence[RunResult]) -> str:
    """Return the confidence of the paths of Table 6.5, beside the published one."""
    counts = counts_of(run_modes(results))
    if any(trials == 0 for _, trials in counts.values()):
        return ""
    automaton = estimate_automaton(counts)
    rows = []
    for origin, goal, modes, printed in TABLE_6_5:
        confidence = automaton.confidence(modes)
        interval = string_interval(counts, modes, seed=0)
        assert confidence is not None
        assert interval is not None
        rows.append(
            [
                f"{origin} to {goal}",
                modes,
                f"{float(confidence):.4f}",
                f"{interval.low:.4f} to {interval.high:.4f}",
                f"{printed:.4f}",
            ]
        )
    return markdown(["path", "modes", "confidence", "95 % interval", "published"], rows)
