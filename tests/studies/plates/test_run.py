"""Whole walks past door plates: three finders, one drive."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.experiment.results import RunKey
from colony.runs.navigation import CEILING_CAMERA
from colony.sim.hazards.hazards import Hazards
from studies.lists import PUBLISHED_MAP
from studies.plates.record import FINDERS, PlateResult, tally
from studies.plates.run import PlateRun
from studies.runs import Run, StudyRun

SPEC = StudyRun(
    key=RunKey("short", 1, 1, "ours"),
    map_path=Path(PUBLISHED_MAP),
    origin="A342L",
    goal="A340R",
    hazards=Hazards.none(),
)

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def walk() -> tuple[PlateResult, PlateRun]:
    """The plates of two doors, in a building in which nothing goes wrong."""
    driven = PlateRun(SPEC)
    try:
        while driven.step():
            pass
        return driven.result(), driven
    finally:
        driven.close()


def test_all_finders_find_and_ours_read_the_plates(walk: tuple[PlateResult, PlateRun]) -> None:
    result, _ = walk
    assert result.failure == ""
    passed = [one.name for one in result.outcomes["ours"] if one.kind != "beyond"]
    assert passed == ["A342"]
    for finder in FINDERS:
        counts = tally(result.outcomes[finder])
        assert (counts.found, counts.missed, counts.unseen) == (len(passed), 0, 0)
    for finder in ("ours", "map"):
        counts = tally(result.outcomes[finder])
        assert (counts.right, counts.false) == (counts.found, 0)


def test_sightings_are_where_plates_really_are(walk: tuple[PlateResult, PlateRun]) -> None:
    result, driven = walk
    places = {plate.door: plate.center for plate in driven.plates}
    for finder in ("ours", "map"):
        [one] = [one for one in result.outcomes[finder] if one.kind == "found"]
        assert one.x_mm == pytest.approx(places[one.name].x, abs=150.0)
        assert one.y_mm == pytest.approx(places[one.name].y, abs=150.0)


def test_finders_do_not_steer(walk: tuple[PlateResult, PlateRun]) -> None:
    _, driven = walk
    alone = Run(SPEC)
    try:
        while alone.step():
            pass
    finally:
        alone.close()
    assert alone.spec.cameras == {CEILING_CAMERA}
    assert alone.world.true_pose(0) == driven.run.world.true_pose(0)
    assert alone.loop.now_ns == driven.run.loop.now_ns


def test_there_is_no_other_camera() -> None:
    from dataclasses import replace

    with pytest.raises(ValueError, match="there is no camera `CServerDown`; expected CServerUp, CServerSide"):
        Run(replace(SPEC, cameras=frozenset({"CServerDown"})))
