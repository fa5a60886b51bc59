"""The probability that a robot reaches its goal: the automaton of thesis section 6.3, in exact fractions.

The input is the string of a plan's modes: l along lights, c around a corner, d to the goal. With a certain
probability, each mode takes the automaton to another state; otherwise the robot is lost.

    S start    F first light of a corridor found    C after a corner    G goal

The probability of an arc is the product of those of the events required on it. The automaton is
deterministic, so the confidence of a string is a product of powers of the events' probabilities.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from math import prod
from types import MappingProxyType
from typing import Literal, NamedTuple

State = Literal["S", "F", "C", "G"]
"""Every run begins in S; a successful one ends in G."""

RIDE = "v"
"""The mode of an elevator ride, which restarts the automaton on the next floor. The thesis has none."""


class Event(Enum):
    """An event of a run that may succeed or fail."""

    START_LIGHT = "the first light is found by a robot that has just started"
    LIGHTS = "the lights of a corridor are followed to the last one, once the first was found"
    CORNER = "a corner is passed"
    CORNER_LIGHT = "the first light behind a corner is found"
    DEAD_RECKONING = "the goal is reached from the last light or corner"


class Arc(NamedTuple):
    """An arc of the automaton: the state that it leads to, and the events required on it."""

    target: State
    events: tuple[Event, ...]


Arcs = Mapping[tuple[State, str], Arc]

PUBLISHED_ARCS: Arcs = MappingProxyType(
    {
        ("S", "l"): Arc("F", (Event.START_LIGHT,)),
        ("S", "c"): Arc("C", (Event.CORNER,)),
        ("F", "c"): Arc("C", (Event.LIGHTS,)),
        ("F", "d"): Arc("G", (Event.LIGHTS, Event.DEAD_RECKONING)),
        ("C", "c"): Arc("C", (Event.CORNER,)),
        ("C", "l"): Arc("F", (Event.CORNER, Event.CORNER_LIGHT)),
        ("C", "d"): Arc("G", (Event.CORNER, Event.DEAD_RECKONING)),
    }
)
"""Arcs of Figure 6.6. A risk is charged when its mode ends; a path that begins
with a corner is charged for it twice, on entering and on leaving it."""

ALL_ARCS: Arcs = MappingProxyType({**PUBLISHED_ARCS, ("S", "d"): Arc("G", (Event.DEAD_RECKONING,))})
"""The published arcs, and one for a path with neither lights nor corners, which the thesis omits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Automaton:
    """The automaton with a probability for each event."""

    events: Mapping[Event, Fraction]
    arcs: Arcs = field(default_factory=lambda: PUBLISHED_ARCS)

    def confidence(self, modes: str) -> Fraction | None:
        """Return the probability of reaching the goal; None if the automaton does not accept the string."""
        powers = powers_of(modes, self.arcs)
        if powers is None:
            return None
        return prod((self.events[event] ** power for event, power in powers.items()), start=Fraction(1))


def powers_of(modes: str, arcs: Arcs = PUBLISHED_ARCS) -> Counter[Event] | None:
    """Count the occurrences of each event required by a string; rides require none.

    Returns:
        None if the string does not lead from S to G, or has nothing but rides.
    """
    powers: Counter[Event] = Counter()
    for part in modes.split(RIDE):
        state: State = "S"
        for symbol in part:
            arc = arcs.get((state, symbol))
            if arc is None:
                return None
            powers.update(arc.events)
            state = arc.target
        if state != "G" and not (part == "" and RIDE in modes):
            return None
    return powers or None


class PublishedConfidence(NamedTuple):
    """A row of Table 6.5; `confidence` as printed."""

    origin: str
    goal: str
    modes: str
    confidence: float


TABLE_6_5 = (
    PublishedConfidence("350R", "376L", "ld", 0.962),
    PublishedConfidence("341L", "311R", "lclcld", 0.8412),
    PublishedConfidence("NE.men.R", "302R", "clclcclccd", 0.6809),
    PublishedConfidence("341R", "381R", "lclclcclcclclclclcd", 0.5110),
)
"""Table 6.5. The printed string of the last row lacks an `lc`; it is restored here, as
its confidence and Table 6.2 require. The confidence of the first row is that of the path from C to G;
by the thesis's own matrices, its string has .9802."""
