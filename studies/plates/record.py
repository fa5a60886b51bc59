"""The results of the plate finders in a run, as data and in the file of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from colony.experiment.results import KEY_COLUMNS, ResultTable, RunKey
from studies.record import FailureReason

Finder = Literal["thesis", "ours", "map"]
"""A finder: that of the thesis; ours, from images, heading and sonar alone; or ours with the map."""

FINDERS: tuple[Finder, ...] = ("thesis", "ours", "map")

FINDER_NAMES: Mapping[Finder, str] = {
    "thesis": "as printed",
    "ours": "ours without the map",
    "map": "ours with the map",
}

Kind = Literal["found", "missed", "unseen", "false", "beyond"]
"""The outcome of a plate, or of a sighting.

found, missed: a plate that was passed and in view for long enough. unseen: a plate that was passed but not in
view for long enough, which no finder can find. false: a sighting of another object, or of a plate that was
sighted before. beyond: a sighting of a plate that was not passed, for example at the end of the route; it
does not count.
"""


class Outcome(NamedTuple):
    """The outcome of a plate or a sighting.

    Attributes:
        kind: the kind of outcome.
        at_ns: the time at which the plate was passed, or of the false sighting.
        name: the door of the plate, or the object that was mistaken for a plate.
        text: the text that was read.
        right: True if the text is that of the plate.
        x_mm, y_mm: the true position of the sighting, or of the plate if there is no sighting.
    """

    kind: Kind
    at_ns: int
    name: str
    text: str
    right: bool
    x_mm: int
    y_mm: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateResult:
    """The result of a run with several finders that looked at the same images.

    Attributes:
        key: key of the run.
        origin, goal: nodes of the map.
        failure: the reason why the run failed; "" if it reached the goal. Outcomes up to a failure are valid.
        time_s: duration of the run in seconds.
        outcomes: the outcomes of each finder in chronological order.
    """

    key: RunKey
    origin: str
    goal: str
    failure: FailureReason
    time_s: float
    outcomes: Mapping[Finder, tuple[Outcome, ...]]


class Tally(NamedTuple):
    """The numbers of found, missed and unseen plates, of plates read correctly, and of false sightings."""

    found: int
    missed: int
    unseen: int
    right: int
    false: int

    @property
    def due(self) -> int:
        """The number of plates that could be found."""
        return self.found + self.missed


def tally(outcomes: Sequence[Outcome]) -> Tally:
    """Count the outcomes by kind."""
    kinds = [outcome.kind for outcome in outcomes]
    return Tally(
        found=kinds.count("found"),
        missed=kinds.count("missed"),
        unseen=kinds.count("unseen"),
        right=sum(outcome.right for outcome in outcomes if outcome.kind == "found"),
        false=kinds.count("false"),
    )


PLATE_TABLE = ResultTable(
    name="plates",
    kind=PlateResult,
    columns=(*KEY_COLUMNS, "origin", "goal", "failure", "time_s", *(f"found_{finder}" for finder in FINDERS)),
)
"""One row per run; the outcomes of each finder are a JSON list."""
