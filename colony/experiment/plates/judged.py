"""Sightings of door plates, compared with the plates that a robot really passed.

A sighting is a plate if it is no farther than `NEAR_MM` from it. Both are compared where the sighting
*really* was: its place relative to the robot, as the finder reports it, applied to the robot's true pose. So
an error of the odometry is not the finder's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from colony.experiment.plates.passed import Pass
from colony.experiment.plates.record import Kind, Outcome
from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Pose

NEAR_MM = 500.0
"""Largest distance of a sighting from its plate; plates hang at least 1.7 m apart."""

LONG_ENOUGH_NS = 500_000_000
"""A plate that was in view for less than this, the period of the Camera Server, may be in no image at all."""

AGAIN, INSTEAD = " again", " instead of "
"""Parts of the names of false sightings: of a plate seen before, and of one taken for another."""


class Sighting(NamedTuple):
    """A sighting of a plate.

    Its time, its true place, the text that was read, "" if none was, and the door of the map's plate that it
    was taken for; None if the finder does not know the map.
    """

    t_ns: int
    place: Point
    text: str
    door: str | None = None


Named = Callable[[Sighting], str]
"""Function that names what is really there, where there is no plate."""


def true_place(place: Point, believed: Pose, true: Pose) -> Point:
    """Return the true place of what a robot takes to be at `place`.

    The robot is at `true` and believes to be at `believed`.
    """
    turned = math.radians(true.heading_deg - believed.heading_deg)
    sine, cosine = math.sin(turned), math.cos(turned)
    dx, dy = place.x - believed.x_mm, place.y - believed.y_mm
    return Point(true.x_mm + cosine * dx - sine * dy, true.y_mm + sine * dx + cosine * dy)


def judged(
    sightings: Sequence[Sighting], plates: Sequence[Plate], passes: Sequence[Pass], named: Named
) -> tuple[Outcome, ...]:
    """Return the outcome of each plate that was passed and of each sighting, in the order of their times.

    Args:
        sightings: in the order of their times.
        plates: all plates of the floor.
        passes: the plates that were passed.
        named: names what is really there, where there is no plate.
    """
    at_ns = {one.plate: one.at_ns for one in passes}
    seen: set[int] = set()
    outcomes: list[Outcome] = []
    for sighting in sightings:
        number = _nearest(sighting.place, plates)
        if number is None:
            outcomes.append(_false(sighting, named(sighting)))
        elif sighting.door not in (None, plates[number].door):
            outcomes.append(_false(sighting, f"{sighting.door}{INSTEAD}{plates[number].door}"))
        elif number in seen:
            outcomes.append(_false(sighting, f"{plates[number].door}{AGAIN}"))
        else:
            seen.add(number)
            outcomes.append(_plate(plates[number], sighting, at_ns.get(number)))
    outcomes += [_not_seen(plates[one.plate], one) for one in passes if one.plate not in seen]
    return tuple(sorted(outcomes, key=lambda one: one.at_ns))


def _nearest(place: Point, plates: Sequence[Plate]) -> int | None:
    def apart(number: int) -> float:
        middle = plates[number].middle
        return math.hypot(middle.x - place.x, middle.y - place.y)

    nearest = min(range(len(plates)), key=apart, default=None)
    return None if nearest is None or apart(nearest) > NEAR_MM else nearest


def _false(sighting: Sighting, name: str) -> Outcome:
    x, y = sighting.place
    return Outcome("false", sighting.t_ns, name, sighting.text, False, round(x), round(y))


def _plate(plate: Plate, sighting: Sighting, passed_ns: int | None) -> Outcome:
    """Return the outcome of a plate that was seen, at the time and place at which it was passed."""
    x, y = sighting.place
    right = sighting.text == plate.text
    if passed_ns is None:
        return Outcome("beyond", sighting.t_ns, plate.door, sighting.text, right, round(x), round(y))
    return Outcome("found", passed_ns, plate.door, sighting.text, right, round(x), round(y))


def _not_seen(plate: Plate, one: Pass) -> Outcome:
    kind: Kind = "missed" if one.in_view_ns >= LONG_ENOUGH_NS else "unseen"
    x, y = plate.middle
    return Outcome(kind, one.at_ns, plate.door, "", False, round(x), round(y))
