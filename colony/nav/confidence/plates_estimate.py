"""What walks past door plates say about the automaton of `confidence_plates.py`: the events E1 to E9 of
Table 6.6, counted as section 6.3 counts them.

A walk is a string: D where a plate was detected, M where one was missed, P where something else was taken for
one. False ones right after each other are one, as the nine labels from a wall of glass bricks are in the
thesis. The probabilities of events "in the middle of a sequence" are parts of all symbols but the first of
each walk: 132, 19 and 11 of 162 there.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Literal

from colony.nav.confidence.estimate import Count
from colony.nav.confidence.plates import PlateEvents

PlateEvent = Literal["E1", "E2", "E3", "E4", "E5", "E6", "E7", "E8", "E9"]

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
"""As published; E3 is assumed to be 1 there."""


def plate_counts(walks: Iterable[str]) -> dict[PlateEvent, Count]:
    """How often each event could come true in these walks, and did.

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


def plate_events(counts: Mapping[PlateEvent, Count]) -> PlateEvents:
    """The automaton with the relative frequencies; what was never tried counts as sure.

    Two plates are never missed in a row there, so that E3 is 1 as in the thesis.
    """

    def rate(event: PlateEvent, untried: int) -> Fraction:
        good, trials = counts[event]
        return Fraction(good, trials) if trials else Fraction(untried)

    return PlateEvents(
        missed_first=rate("E1", 0),
        missed=rate("E2", 0),
        read_after_miss=Fraction(1),
        read_first=rate("E4", 1),
        read=rate("E5", 1),
        missed_after_false=rate("E6", 0),
        false_first=rate("E7", 0),
        read_after_false=rate("E8", 1),
        false=rate("E9", 0),
    )
