"""Statistics of plate finders over many runs, and the comparison with targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from studies.confidence.estimate import Count
from studies.confidence.plates import PlateEvent, plate_counts
from studies.figures import Target, rate
from studies.plates.judging import AGAIN_SUFFIX, INSTEAD_OF
from studies.plates.record import FINDER_NAMES, Finder, Kind, PlateResult, Tally, tally

_SYMBOLS: dict[Kind, str] = {"found": "D", "missed": "M", "false": "P", "unseen": "M", "beyond": ""}
"""Symbols of the automaton of section 6.3, which does not distinguish why a plate was missed."""


def total(results: Sequence[PlateResult], finder: Finder) -> Tally:
    """Return the counts of a finder over runs."""
    tallies = [tally(result.outcomes[finder]) for result in results]
    return Tally(*(sum(counts) for counts in zip(*tallies, strict=True))) if tallies else Tally(0, 0, 0, 0, 0)


def walks(results: Sequence[PlateResult], finder: Finder) -> tuple[str, ...]:
    """Return each run as a string of D, M and P, for `plate_counts`."""
    return tuple("".join(_SYMBOLS[outcome.kind] for outcome in r.outcomes[finder]) for r in results)


def events(results: Sequence[PlateResult], finder: Finder) -> dict[PlateEvent, Count]:
    """Return the events of Table 6.6."""
    return plate_counts(walks(results, finder))


def taken_for_plates(results: Sequence[PlateResult], finder: Finder) -> Counter[str]:
    """Count the objects that false sightings mistook for plates; all plates count as one kind."""
    return Counter(
        _object_name(outcome.name)
        for r in results
        for outcome in r.outcomes[finder]
        if outcome.kind == "false"
    )


def _object_name(name: str) -> str:
    if name.endswith(AGAIN_SUFFIX):
        return f"a plate{AGAIN_SUFFIX}"
    return f"a plate{INSTEAD_OF}another" if INSTEAD_OF in name else name


def plate_targets(results: Sequence[PlateResult]) -> tuple[Target, ...]:
    """Compare the finders with the promised values."""
    ours, with_map = total(results, "ours"), total(results, "map")
    return (
        _at_least("plates found", "ours", Count(ours.found, ours.due), 0.97),
        _at_most_false(ours),
        _at_least("plates found", "map", Count(with_map.found, with_map.due), 0.99),
        Target(
            what=f"false plates, {FINDER_NAMES['map']}",
            found=f"{with_map.false} beside {with_map.found} true ones",
            promised="none",
            met=with_map.found > 0 and with_map.false == 0,
        ),
        _at_least("numbers read right", "ours", Count(ours.right, ours.found), 0.99),
        _at_least("numbers read right", "map", Count(with_map.right, with_map.found), 0.99),
    )


def _at_least(what: str, finder: Finder, count: Count, promised: float) -> Target:
    return Target(
        what=f"{what}, {FINDER_NAMES[finder]}",
        found=rate(count),
        promised=f"at least {promised:g}",
        met=count.trials > 0 and count.successes >= promised * count.trials,
    )


def _at_most_false(ours: Tally) -> Target:
    false_percent = 100.0 * ours.false / ours.found if ours.found else float("inf")
    return Target(
        what=f"false plates, {FINDER_NAMES['ours']}",
        found=f"{ours.false} beside {ours.found} true ones, {false_percent:.2f} in 100",
        promised="at most 1 in 100",
        met=false_percent <= 1.0,
    )
