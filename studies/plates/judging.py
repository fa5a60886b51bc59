"""The comparison of sightings of door plates with the plates that the robot actually passed.

A sighting matches a plate within `MATCH_RADIUS_MM` of its *true* position. That is the reported position
relative to the robot, applied to the robot's true pose, so that odometry errors do not count against the
finder.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Pose
from studies.plates.passed import Pass
from studies.plates.record import Kind, Outcome

MATCH_RADIUS_MM = 500.0
"""Maximum distance in mm of a sighting from its plate; plates hang at least 1.7 m apart."""

MIN_VIEW_NS = 500_000_000
"""Minimum time in view that ensures an image of a plate: the period of the camera server."""

AGAIN_SUFFIX, INSTEAD_OF = " again", " instead of "
"""Parts of the names of false sightings: a plate that was seen before, and one mistaken for another."""


class Sighting(NamedTuple):
    """A sighting of a plate.

    It has the time, the true position, the text that was read ("" for none), and the door of the matched
    plate on the map (None if the finder has no map).
    """

    t_ns: int
    position: Point
    text: str
    door: str | None = None


NameSighting = Callable[[Sighting], str]
"""Function that names the real object of a sighting that is not a plate."""


def true_position(position: Point, estimated_pose: Pose, true_pose: Pose) -> Point:
    """Return the true position of an object, given its estimated position.

    `true_pose` is that of the robot, `estimated_pose` the estimate of it.
    """
    turned = math.radians(true_pose.heading_deg - estimated_pose.heading_deg)
    sine, cosine = math.sin(turned), math.cos(turned)
    dx, dy = position.x - estimated_pose.x_mm, position.y - estimated_pose.y_mm
    return Point(true_pose.x_mm + cosine * dx - sine * dy, true_pose.y_mm + sine * dx + cosine * dy)


def judge_sightings(
    sightings: Sequence[Sighting],
    plates: Sequence[Plate],
    passes: Sequence[Pass],
    name_sighting: NameSighting,
) -> tuple[Outcome, ...]:
    """Return the outcomes of all passed plates and of all sightings, in chronological order.

    Args:
        sightings: the sightings in chronological order.
        plates: all plates of the floor.
        passes: the plates that were passed.
        name_sighting: a function that names the real object of a sighting that is not a plate.
    """
    at_ns = {passage.plate: passage.at_ns for passage in passes}
    found: set[int] = set()
    outcomes: list[Outcome] = []
    for sighting in sightings:
        number = _nearest(sighting.position, plates)
        if number is None:
            outcomes.append(_false(sighting, name_sighting(sighting)))
        elif sighting.door not in (None, plates[number].door):
            outcomes.append(_false(sighting, f"{sighting.door}{INSTEAD_OF}{plates[number].door}"))
        elif number in found:
            outcomes.append(_false(sighting, f"{plates[number].door}{AGAIN_SUFFIX}"))
        else:
            found.add(number)
            outcomes.append(_plate(plates[number], sighting, at_ns.get(number)))
    outcomes += [
        _not_found(plates[passage.plate], passage) for passage in passes if passage.plate not in found
    ]
    return tuple(sorted(outcomes, key=lambda outcome: outcome.at_ns))


def _nearest(position: Point, plates: Sequence[Plate]) -> int | None:
    def distance(number: int) -> float:
        middle = plates[number].center
        return math.hypot(middle.x - position.x, middle.y - position.y)

    nearest = min(range(len(plates)), key=distance, default=None)
    return None if nearest is None or distance(nearest) > MATCH_RADIUS_MM else nearest


def _false(sighting: Sighting, name: str) -> Outcome:
    x, y = sighting.position
    return Outcome("false", sighting.t_ns, name, sighting.text, False, round(x), round(y))


def _plate(plate: Plate, sighting: Sighting, passed_ns: int | None) -> Outcome:
    """Return the outcome of a sighted plate: the time of passing, and the position of the sighting."""
    x, y = sighting.position
    is_correct = sighting.text == plate.text
    if passed_ns is None:
        return Outcome("beyond", sighting.t_ns, plate.door, sighting.text, is_correct, round(x), round(y))
    return Outcome("found", passed_ns, plate.door, sighting.text, is_correct, round(x), round(y))


def _not_found(plate: Plate, passage: Pass) -> Outcome:
    kind: Kind = "missed" if passage.in_view_ns >= MIN_VIEW_NS else "unseen"
    x, y = plate.center
    return Outcome(kind, passage.at_ns, plate.door, "", False, round(x), round(y))
