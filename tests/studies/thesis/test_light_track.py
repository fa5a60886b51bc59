from __future__ import annotations

from colony.nav.pose.pose import fix_of
from colony.nav.shared import LIGHT_FIX
from colony.vision.lights.scan_lines import SeenLight
from colony.vision.lights.track import LightDetections, LightGoal, LightPassing, OdometryScale
from studies.thesis.light_track import PERIOD_S, ThesisTrack
from tests.vision.lights.corridors import Robot
from tests.vision.lights.test_tracker import ceiling, driven, numbers

GOAL = LightGoal(direction_deg=0.0, x_mm=0.0, y_mm=0.0, lights_mm=(2000.0, 7500.0, 13000.0))


def travel(lights: tuple[float, ...], *, to_mm: float = 14_000.0) -> list[LightPassing]:
    track, found = ThesisTrack.start(GOAL, OdometryScale()), []
    for true in range(0, round(to_mm), 150):
        seen = tuple(SeenLight(p - true, None, 3, True, 1.0) for p in lights if abs(p - true) < 450.0)
        track = track.observed(LightDetections(seen, float(true), 0.0))
        track, passing = track.passing(float(true))
        if passing is not None:
            found.append(passing)
    return found


def test_every_transition_to_light_counts_once() -> None:
    found = travel(GOAL.lights_mm)
    assert [p.number for p in found] == [1, 2, 3]
    assert all(p.valid and 0.0 <= p.beyond_mm <= 300.0 for p in found)


def test_the_distance_from_the_light_before_verifies_it() -> None:
    assert [p.number for p in travel((500.0, 2000.0, 4500.0, 7500.0, 10_200.0, 13_000.0))] == [1, 2, 3]


def test_a_light_that_is_out_is_counted_with_the_next_one() -> None:
    assert [p.number for p in travel((2000.0, 13_000.0))] == [1, 3]


def test_a_last_light_that_is_out_is_never_passed() -> None:
    assert [p.number for p in travel((2000.0, 7500.0), to_mm=30_000.0)] == [1, 2]


def test_a_robot_that_is_lost_counts_nothing() -> None:
    assert travel(tuple(place + 2700.0 for place in GOAL.lights_mm[:2])) == []


def test_as_printed_no_fix_is_told() -> None:
    stage = driven(ceiling(), Robot(scale=1.01), kind=ThesisTrack, period_s=PERIOD_S)
    assert numbers(stage)[-1] == 5
    assert stage.base.corrections == []
    assert fix_of(stage.variable(LIGHT_FIX)) is None


def test_as_printed_a_last_light_that_is_out_ends_nothing() -> None:
    stage = driven(ceiling(4), Robot(), kind=ThesisTrack, period_s=PERIOD_S)
    assert numbers(stage) == [0, 1, 2, 3, 4]
    assert stage.log.overshoots == []
