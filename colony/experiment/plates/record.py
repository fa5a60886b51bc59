"""The results of the plate finders in one run, as data and as a table of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from colony.experiment.record import FailureReason, RunKey
from colony.experiment.results import KEY_COLUMNS, Table

Finder = Literal["thesis", "ours", "map"]
"""A finder: the thesis's as printed; ours, which knows only images, heading and sonar; ours with the map."""

FINDERS: tuple[Finder, ...] = ("thesis", "ours", "map")

FINDER_NAMES: Mapping[Finder, str] = {
    "thesis": "as printed",
    "ours": "ours without the map",
    "map": "ours with the map",
}

Kind = Literal["found", "missed", "unseen", "false", "beyond"]
"""The outcome of a plate, or of a sighting.

found, missed: a plate that was passed, and in view for long enough. unseen: one that was passed, but not in
view for long enough: no finder can find it. false: a sighting of something else, or of a plate once more.
beyond: a sighting of a plate that was not passed, as at the end of the way; it counts neither way.
"""


class Outcome(NamedTuple):
    """One plate or sighting.

    `at_ns` is when the plate was passed, of false ones when they were seen; `name` the door, or what was
    taken for a plate; `text` what was read, `right` whether that is on the plate; (x_mm, y_mm) where the
    sighting really was, or the plate.
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
    """One run with several finders that looked at the same images.

    Attributes:
        key: key of the run.
        origin, goal: nodes of the map.
        failure: why the drive failed; "" where it reached the goal. What was found until then counts.
        time_s: duration of the drive.
        outcomes: of each finder, in the order of their times.
    """

    key: RunKey
    origin: str
    goal: str
    failure: FailureReason
    time_s: float
    outcomes: Mapping[Finder, tuple[Outcome, ...]]


class Tally(NamedTuple):
    """Counts of plates that were found, missed and out of view.

    With them come the number of found plates that were read right, and the number of false sightings.
    """

    found: int
    missed: int
    unseen: int
    right: int
    false: int

    @property
    def due(self) -> int:
        """The plates that could be found."""
        return self.found + self.missed


def tally(outcomes: Sequence[Outcome]) -> Tally:
    """Count them."""
    kinds = [one.kind for one in outcomes]
    return Tally(
        found=kinds.count("found"),
        missed=kinds.count("missed"),
        unseen=kinds.count("unseen"),
        right=sum(one.right for one in outcomes if one.kind == "found"),
        false=kinds.count("false"),
    )


PLATE_TABLE = Table(
    name="plates",
    kind=PlateResult,
    columns=(*KEY_COLUMNS, "origin", "goal", "failure", "time_s", *(f"found_{finder}" for finder in FINDERS)),
)
"""A row a run; what came of each finder is a JSON list of `Outcome`s."""
