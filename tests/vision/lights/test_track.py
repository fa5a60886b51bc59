from __future__ import annotations

import math

import pytest

from colony.vision.lights.scan_lines import SeenLight
from colony.vision.lights.track import (
    LightDetections,
    LightGoal,
    LightPassing,
    LightTrack,
    OdometryScale,
    tolerance_mm,
)

SPACING = 5500.0
GOAL = LightGoal(direction_deg=0.0, x_mm=0.0, y_mm=0.0, lights_mm=(2000.0, 7500.0, 13000.0))
VIEW_MM = 420.0
STEP_MM = 100.0


def travel(
    track: LightTrack,
    lights: tuple[float, ...],
    *,
    to_mm: float,
    from_mm: float = 0.0,
    off_mm: float = 0.0,
    scale: float = 1.0,
    turned_deg: float = 0.0,
) -> tuple[LightTrack, list[tuple[float, LightPassing]]]:
    """Go below these lights, reporting `scale` times the way and `off_mm` more; what was passed,
    and where."""
    passed, true = [], from_mm
    while true < to_mm:
        true += STEP_MM
        reported = scale * true + off_mm
        tilt = turned_deg
        seen = tuple(SeenLight(p - true, tilt, 3, True, 1.0) for p in lights if abs(p - true) <= VIEW_MM)
        track = track.observed(LightDetections(seen, reported, 0.0))
        track, passing = track.passing(reported)
        if passing is not None:
            passed.append((true, passing))
    return track, passed


def start(scale: OdometryScale | None = None) -> LightTrack:
    return LightTrack.start(GOAL, scale or OdometryScale())


def test_lights_count_when_the_center_is_below_them() -> None:
    track, passed = travel(start(), GOAL.lights_mm, to_mm=14_000.0)
    assert track.done
    assert [(p.number, p.valid) for _, p in passed] == [(1, True), (2, True), (3, True)]
    for place, (at, passing) in zip(GOAL.lights_mm, passed, strict=True):
        assert place <= at <= place + STEP_MM
        assert passing.beyond_mm == pytest.approx(at - place, abs=1.0)


@pytest.mark.parametrize("off", [-350.0, -80.0, 200.0, 350.0])
def test_the_first_light_corrects_where_the_robot_is(off: float) -> None:
    track, passed = travel(start(), GOAL.lights_mm, to_mm=2500.0, off_mm=off)
    assert passed[0][0] == pytest.approx(GOAL.lights_mm[0], abs=STEP_MM + 10.0)
    assert track.reckoning.error_mm == pytest.approx(-off, abs=10.0)


def test_the_scale_is_learned_and_outlives_the_goal() -> None:
    first, _ = travel(start(), GOAL.lights_mm, to_mm=14_000.0, scale=1.015)
    assert first.reckoning.scale.error == pytest.approx(1 / 1.015 - 1, abs=0.002)
    second = LightTrack.start(GOAL, first.reckoning.scale)
    assert second.reckoned(5000.0).progress_mm == pytest.approx(5000.0 / 1.015, abs=15.0)


@pytest.mark.parametrize("out", [0, 1, 2])
def test_a_light_that_is_out_is_passed_by_dead_reckoning(out: int) -> None:
    on = tuple(place for i, place in enumerate(GOAL.lights_mm) if i != out)
    track, passed = travel(start(), on, to_mm=14_000.0)
    assert track.done
    assert [p.valid for _, p in passed] == [i != out for i in range(3)]
    for place, (at, _) in zip(GOAL.lights_mm, passed, strict=True):
        assert place <= at <= place + 300.0


def test_without_any_image_the_robot_must_be_beyond_all_places_where_the_light_could_be() -> None:
    track = start()
    at = GOAL.lights_mm[0] + tolerance_mm(track.reckoning.moved(2000.0), GOAL.lights_mm)
    _, before = track.passing(at - 30.0)
    _, after = track.passing(at + 30.0)
    assert before is None
    assert not after.valid


def test_a_robot_that_swerves_cannot_tell_that_a_light_is_out() -> None:
    reported = [1700.0, 1800.0, 1900.0, 2000.0]
    for tilt, looks in ((0.0, 4), (40.0, 0), (-40.0, 0)):
        track = start()
        for at in reported:
            track = track.observed(LightDetections((), at, tilt))
        assert track.dark_images == looks


def test_the_tolerance_grows_with_the_way_and_never_reaches_the_next_light() -> None:
    fixed = start().reckoning.updated(0.0, 400.0)
    near, far = (tolerance_mm(fixed.moved(way), GOAL.lights_mm) for way in (0.0, SPACING))
    assert 160.0 < near < far < SPACING / 2
    assert tolerance_mm(start().reckoning.anchored(0.0, 1e6), GOAL.lights_mm) < SPACING / 2


def test_a_reflection_is_no_light() -> None:
    track, passed = travel(start(), (600.0, *GOAL.lights_mm, 10_000.0), to_mm=14_000.0)
    assert [p.number for _, p in passed] == [1, 2, 3]
    assert abs(track.reckoning.error_mm) < 5.0


def test_two_strays_as_far_apart_as_two_lights_tell_a_lost_robot_where_it_is() -> None:
    track, passed = travel(start(), GOAL.lights_mm, to_mm=14_000.0, off_mm=1200.0)
    assert track.done
    assert passed[-1][1].valid
    assert passed[-1][0] == pytest.approx(GOAL.lights_mm[-1], abs=STEP_MM + 10.0)
    assert track.reckoning.error_mm == pytest.approx(-1200.0, abs=20.0)


def test_half_a_light_counts_only_until_one_is_seen_whole() -> None:
    half, whole = SeenLight(500.0, None, 2, False, 0.3), SeenLight(380.0, None, 3, True, 1.0)
    track = start().observed(LightDetections((half,), 1480.0, 0.0))
    assert (track.errors_mm, track.seen_whole) == ((20.0,), False)
    track = track.observed(LightDetections((whole,), 1620.0, 0.0))
    assert (track.errors_mm, track.seen_whole) == ((0.0,), True)
    assert track.observed(LightDetections((half,), 1480.0, 0.0)) == track


def test_tilted_edges_tell_by_how_much_the_heading_is_off() -> None:
    _, passed = travel(start(), GOAL.lights_mm, to_mm=2500.0, turned_deg=7.0)
    assert passed[0][1].heading_error_deg == pytest.approx(7.0)
    _, passed = travel(start(), (), to_mm=2500.0)
    assert passed[0][1].heading_error_deg is None


def test_what_others_correct_in_between_is_no_error_of_old_images() -> None:
    track, _ = travel(start(), GOAL.lights_mm, to_mm=1900.0, from_mm=1500.0, off_mm=60.0)
    corrected = track.corrected(-60.0)
    assert corrected.reckoned(1900.0).progress_mm == pytest.approx(track.reckoned(1960.0).progress_mm)


@pytest.mark.parametrize("heading", [0.0, 90.0, 217.0])
def test_progress_and_tilt_are_along_the_direction(heading: float) -> None:
    goal = LightGoal(direction_deg=heading, x_mm=100.0, y_mm=-50.0, lights_mm=(1000.0,))
    east, north = -math.sin(math.radians(heading)), math.cos(math.radians(heading))
    assert goal.progress(100.0 + 700.0 * east, -50.0 + 700.0 * north) == pytest.approx(700.0)
    assert goal.progress(100.0 + 9.0 * north, -50.0 - 9.0 * east) == pytest.approx(0.0)
    assert goal.tilt(heading + 365.0) == pytest.approx(5.0)
    assert goal.tilt(heading - 10.0) == pytest.approx(-10.0)


def test_a_goal_without_lights_is_done() -> None:
    goal = LightGoal(direction_deg=0.0, x_mm=0.0, y_mm=0.0, lights_mm=())
    track = LightTrack.start(goal, OdometryScale())
    assert track.done
    assert track.passing(1000.0) == (track, None)
    assert track.to_next(0.0) is None
