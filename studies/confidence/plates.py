"""The probability that all door plates of a corridor are detected: thesis Figures 6.8 and 6.9.

The model allows at most one missed plate, and at most one false one, between two detected plates (section
6.3).

Its events E1 to E9 (Table 6.6) are counted in walks, as in section 6.3. A walk is a string: D for a detected
plate, M for a missed one, P for a false one. Successive false plates count once, as the nine labels from a
wall of glass bricks do in the thesis. The probabilities of events "in the middle of a sequence" are relative
to all symbols but the first of each walk: 132, 19 and 11 of 162 there.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Literal

from studies.confidence.estimate import Count

PlateEvent = Literal["E1", "E2", "E3", "E4", "E5", "E6", "E7", "E8", "E9"]

PlateEvents = Mapping[PlateEvent, Fraction]
"""The probability of each event."""

EVENT_NAMES: Mapping[PlateEvent, str] = {
    "E1": "the first plate is missed",
    "E2": "another plate is missed",
    "E3": "a plate is detected after a missed one",
    "E4": "the first plate is detected",
    "E5": "another plate is detected",
    "E6": "a plate is missed after a false one",
    "E7": "something false comes first",
    "E8": "a plate is detected after a false one",
    "E9": "something false comes in the middle",
}

_DETECTED = ("E3", "E4", "E5", "E8")


def all_detected_as_printed(events: PlateEvents, plates: int) -> Fraction:
    """Return p5 to the power of `plates`: the thesis's probability that all plates are detected.

    It treats the first plate like the others, and a false plate in between as a failure.
    """
    return events["E5"] ** plates


def all_detected(events: PlateEvents, plates: int) -> Fraction:
    """Return the probability that all plates are detected, with or without false ones in between.

    Each plate is detected at once or after one false plate: Figure 6.9 has no arc from one false plate to
    the next.
    """
    first = events["E4"] + events["E7"] * events["E8"]
    other = events["E5"] + events["E9"] * events["E8"]
    return first * other ** (plates - 1) if plates else Fraction(1)


def plate_counts(walks: Iterable[str]) -> dict[PlateEvent, Count]:
    """Count the trials and successes of each event in these walks.

    Raises:
        ValueError: a walk has letters other than D, M and P.
    """
    starts: list[str] = []
    middles: list[str] = []
    after_missed: list[str] = []
    after_false: list[str] = []
    for walk in walks:
        if set(walk) - set("DMP"):
            raise ValueError(f"the walk `{walk}`; expected letters D, M and P")
        collapsed = re.sub("P+", "P", walk)
        starts += collapsed[:1]
        middles += collapsed[1:]
        after_missed += re.findall("(?<=M)[DM]", collapsed)
        after_false += re.findall("(?<=P)[DM]", collapsed)

    def count(letter: str, symbols: list[str]) -> Count:
        return Count(symbols.count(letter), len(symbols))

    return {
        "E1": count("M", starts),
        "E2": count("M", middles),
        "E3": count("D", after_missed),
        "E4": count("D", starts),
        "E5": count("D", middles),
        "E6": count("M", after_false),
        "E7": count("P", starts),
        "E8": count("D", after_false),
        "E9": count("P", middles),
    }


def plate_events(counts: Mapping[PlateEvent, Count | None]) -> PlateEvents:
    """Return the relative frequencies; untried events count as certain.

    E3 is 1 as in the thesis, where two plates are never missed in a row.
    """
    return {
        event: Fraction(*count) if count and count.trials and event != "E3" else Fraction(event in _DETECTED)
        for event, count in counts.items()
    }


TABLE_6_6_COUNTS: Mapping[PlateEvent, Count | None] = {
    "E1": Count(0, 11),
    "E2": Count(19, 162),
    "E3": None,
    "E4": Count(11, 11),
    "E5": Count(132, 162),
    "E6": Count(1, 11),
    "E7": Count(0, 11),
    "E8": Count(10, 11),
    "E9": Count(11, 162),
}
"""The published counts; the thesis assumes that E3 is 1."""

TABLE_6_6 = plate_events(TABLE_6_6_COUNTS)
"""The published probabilities, from the eleven walks of Table 6.3."""
