"""The probability that all door plates of a corridor are detected: thesis Figures 6.8 and 6.9.

The model allows at most one missed plate, and at most one false one, between two detected plates (section
6.3).

Its events E1 to E9 (Table 6.6) are counted in walks, as in section 6.3. A walk is a string: D for a detected
plate, M for a missed one, P for a false one. Successive false ones count once, as the nine labels from a wall
of glass bricks do in the thesis. The probabilities of events "in the middle of a sequence" are relative to
all symbols but the first of each walk: 132, 19 and 11 of 162 there.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Literal

from colony.nav.confidence.estimate import Count

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


def all_as_printed(events: PlateEvents, plates: int) -> Fraction:
    """Return p5 to the power of `plates`: the thesis's probability that all plates are detected.

    It treats the first plate like the others, and a false one in between as a failure.
    """
    return events["E5"] ** plates


def all_detected(events: PlateEvents, plates: int) -> Fraction:
    """Return the probability that all plates are detected, whatever false ones are seen in between.

    A path detects each plate at once or after one false one, as Figure 6.9 has no arc from one false one to
    the next.
    """
    first = events["E4"] + events["E7"] * events["E8"]
    other = events["E5"] + events["E9"] * events["E8"]
    return first * other ** (plates - 1) if plates else Fraction(1)


def plate_counts(walks: Iterable[str]) -> dict[PlateEvent, Count]:
    """Count the trials and successes of each event in these walks.

    Raises:
        ValueError: a walk has other letters than D, M and P.
    """
    starts: list[str] = []
    middles: list[str] = []
    after_missed: list[str] = []
    after_false: list[str] = []
    for walk in walks:
        if set(walk) - set("DMP"):
            raise ValueError(f"the walk `{walk}`; expected letters D, M and P")
        once = re.sub("P+", "P", walk)
        starts += once[:1]
        middles += once[1:]
        after_missed += re.findall("(?<=M)[DM]", once)
        after_false += re.findall("(?<=P)[DM]", once)

    def part(letter: str, of: list[str]) -> Count:
        return Count(of.count(letter), len(of))

    return {
        "E1": part("M", starts),
        "E2": part("M", middles),
        "E3": part("D", after_missed),
        "E4": part("D", starts),
        "E5": part("D", middles),
        "E6": part("M", after_false),
        "E7": part("P", starts),
        "E8": part("D", after_false),
        "E9": part("P", middles),
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
"""Counts as published; E3 is assumed to be 1 there."""

TABLE_6_6 = plate_events(TABLE_6_6_COUNTS)
"""Probabilities as published, from the eleven walks of Table 6.3."""
