"""Markdown tables of plate finders: our results beside the published ones."""

from __future__ import annotations

from collections.abc import Sequence

from studies.confidence.estimate import Count
from studies.confidence.plates import (
    EVENT_NAMES,
    TABLE_6_6,
    TABLE_6_6_COUNTS,
    PlateEvent,
    PlateEvents,
    all_detected,
    all_detected_as_printed,
    plate_events,
)
from studies.confidence.published_plates import PUBLISHED_WALKS
from studies.figures import rate
from studies.lists import ListedRun
from studies.plates.figures import (
    events,
    plate_targets,
    taken_for_plates,
    total,
)
from studies.plates.record import FINDER_NAMES, FINDERS, Finder, PlateResult
from studies.tables import markdown, targets_markdown

_PLATES = 15
"""Number of plates of the corridor for the probability that all are detected: the mean of the walks."""


def plate_tables(walks: Sequence[ListedRun], results: Sequence[PlateResult]) -> list[str]:
    """Return all tables, for a page or a terminal; none without results."""
    if not results:
        return []
    tables = [
        plate_target_table(results),
        walk_table(walks, results),
        finder_table(results),
        false_table(results),
        plate_event_table(results),
        missed_table(results),
    ]
    return [table for table in tables if table]


def plate_target_table(results: Sequence[PlateResult]) -> str:
    """Compare the finders with the promised values, in Markdown."""
    return targets_markdown(plate_targets(results))


def walk_table(walks: Sequence[ListedRun], results: Sequence[PlateResult]) -> str:
    """Return a table with one row per walk: the counts of each finder over all seeds, and as published."""
    head = ["walk", "from", "to", "reached", "plates", "out of view"]
    head += [f"{FINDER_NAMES[finder]}: found, missed, false" for finder in FINDERS]
    head += ["published: found, missed, false"]
    rows = []
    for walk in walks:
        of_walk = [result for result in results if result.key.number == walk.number]
        if not of_walk:
            continue
        published = PUBLISHED_WALKS[walk.number - 1]
        counts = {finder: total(of_walk, finder) for finder in FINDERS}
        reached = sum(not result.failure for result in of_walk)
        ours = counts["ours"]
        rows.append(
            [
                str(walk.number),
                walk.origin,
                walk.goal,
                f"{reached}/{len(of_walk)}",
                str(ours.due),
                str(ours.unseen),
                *(f"{tally.found}, {tally.missed}, {tally.false}" for tally in counts.values()),
                f"{len(published.found)}, {len(published.missed)}, {len(published.false)}",
            ]
        )
    return markdown(head, rows)


def finder_table(results: Sequence[PlateResult]) -> str:
    """Return a table with one row per finder: its rates, with exact 95 % intervals."""
    rows = []
    for finder in FINDERS:
        count = total(results, finder)
        sightings = count.found + count.false
        rows.append(
            [
                FINDER_NAMES[finder],
                rate(Count(count.found, count.due)),
                rate(Count(count.found, count.due + count.unseen)),
                rate(Count(count.false, sightings)),
                rate(Count(count.right, count.found)) if finder != "thesis" else "does not read",
            ]
        )
    found, missed, false = (
        sum(len(plates) for plates in walks_plates)
        for walks_plates in zip(
            *((walk.found, walk.missed, walk.false) for walk in PUBLISHED_WALKS), strict=True
        )
    )
    rows.append(
        [
            "published",
            "",
            rate(Count(found, found + missed)),
            rate(Count(false, found + false)),
            "does not read",
        ]
    )
    head = [
        "finder",
        "found, of those in view",
        "found, of those passed",
        "false, of sightings",
        "read right",
    ]
    return markdown(head, rows)


def false_table(results: Sequence[PlateResult]) -> str:
    """Return a table of the objects mistaken for plates, with counts; "" for none."""
    counts = {finder: taken_for_plates(results, finder) for finder in FINDERS}
    names = sorted(set().union(*counts.values()))
    rows = [[name, *(str(counts[finder][name]) for finder in FINDERS)] for name in names]
    head = ["taken for a plate", *(FINDER_NAMES[finder] for finder in FINDERS)]
    return markdown(head, rows) if rows else ""


def plate_event_table(results: Sequence[PlateResult]) -> str:
    """Return the events of Table 6.6 and the probabilities for `_PLATES` plates, ours and published."""
    counts = {finder: events(results, finder) for finder in FINDERS}
    rows = [
        [
            event,
            name,
            *(_ratio_text(counts[finder][event]) for finder in FINDERS),
            _published_text(event),
        ]
        for event, name in EVENT_NAMES.items()
    ]
    automata = [*(plate_events(counts[finder]) for finder in FINDERS), TABLE_6_6]
    rows.append(["", f"p5 to the power of {_PLATES}", *(_power_text(automaton) for automaton in automata)])
    rows.append(
        [
            "",
            f"all of {_PLATES} detected, by the matrix",
            *(_all_detected_text(automaton) for automaton in automata),
        ]
    )
    head = ["event", "", *(FINDER_NAMES[finder] for finder in FINDERS), "published"]
    return markdown(head, rows)


_OUR_FINDERS: tuple[Finder, ...] = ("ours", "map")


def missed_table(results: Sequence[PlateResult]) -> str:
    """Return a table of the plates that our finders missed or misread, and of false sightings."""
    rows = []
    for result in results:
        for finder in _OUR_FINDERS:
            for outcome in result.outcomes[finder]:
                wrong = outcome.kind == "found" and not outcome.right
                if not wrong and outcome.kind not in ("missed", "false"):
                    continue
                description = f"read as {outcome.text or 'nothing'}" if wrong else outcome.kind
                run = [str(result.key.number), str(result.key.seed), f"{outcome.at_ns / 1e9:.1f} s"]
                rows.append([*run, FINDER_NAMES[finder], outcome.name, description])
    return markdown(["walk", "seed", "after", "finder", "plate", "what happened"], rows) if rows else ""


def _ratio_text(count: Count) -> str:
    return f"{count.successes}/{count.trials}"


def _published_text(event: PlateEvent) -> str:
    count = TABLE_6_6_COUNTS[event]
    return "1, assumed" if count is None else _ratio_text(count)


def _power_text(automaton: PlateEvents) -> str:
    return f"{float(all_detected_as_printed(automaton, _PLATES)):.4f}"


def _all_detected_text(automaton: PlateEvents) -> str:
    return f"{float(all_detected(automaton, _PLATES)):.4f}"
