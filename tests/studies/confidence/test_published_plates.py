"""The published walks past door plates: the table agrees with what section 6.3 says of it."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from colony.nav.maps.signs import Plate, plates_of
from colony.nav.maps.stickrep.geometry import direction
from colony.nav.plan.plan import Segment
from colony.nav.plan.route import plan
from studies.confidence.published_plates import PUBLISHED_WALKS, PublishedWalk
from tests.buildings import MSU

FLOOR = MSU
PLATES = plates_of(FLOOR)


def test_totals_are_those_of_section_6_3() -> None:
    found, missed, false = (
        sum(len(getattr(walk, what)) for walk in PUBLISHED_WALKS) for what in ("found", "missed", "false")
    )
    assert (found, missed, false) == (132 + 11, 19, 11)
    assert found - len(PUBLISHED_WALKS) + missed + false == 162


@pytest.mark.parametrize("walk", PUBLISHED_WALKS, ids=lambda walk: f"{walk.origin}-{walk.goal}")
def test_the_map_has_the_plates_of_a_walk_on_its_left_in_this_order(walk: PublishedWalk) -> None:
    passed = [
        plate.door
        for leg in plan(FLOOR, walk.origin, walk.goal).segments
        for plate in _along(leg)
        if 0.0 < _place(plate.center, leg)[0] < leg.length_mm and 0.0 < _place(plate.center, leg)[1] < 2500.0
    ]
    found = [text for text in walk.found if text in passed]
    assert found == sorted(found, key=passed.index)
    doors = {*walk.found, *walk.missed} & {plate.door for plate in PLATES}
    assert len(doors - set(passed)) <= 1  # the plate of the goal hangs beyond its jamb


def _place(point: Sequence[float], leg: Segment) -> tuple[float, float]:
    """How far along a leg a point is, and how far to its left."""
    unit = direction(leg.heading_deg)
    x, y = point[0] - leg.start.x_mm, point[1] - leg.start.y_mm
    return x * unit.x + y * unit.y, y * unit.x - x * unit.y


def _along(leg: Segment) -> list[Plate]:
    return sorted(PLATES, key=lambda plate: _place(plate.center, leg)[0])
