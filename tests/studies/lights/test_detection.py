"""Lights that are told, held against those that are on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from colony.experiment.results import Results, RunKey
from colony.nav.maps.stickrep.model import Pose
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.hazards.scenery import CeilingLight, bare_scenery
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.observing import CeilingObservation
from colony.vision.lights.scan_lines import SeenLight, ceiling_lights
from studies.lights.detection import MATCH_RADIUS_MM, LightDetection, LightDetectionMonitor
from studies.lights.results import LIGHT_TABLE, LightResult, light_tables, light_targets
from studies.lists import published_list

NORTH = CeilingLight(x_mm=0.0, y_mm=5_000.0, heading_deg=0.0)


def _told(ahead_mm: float) -> CeilingObservation:
    return CeilingObservation(0, (SeenLight(ahead_mm, None, 3, True, 1.0),))


def _watch(*lights: CeilingLight) -> LightDetectionMonitor:
    return LightDetectionMonitor(lights)


def _drive(
    watch: LightDetectionMonitor, heading_deg: float = 0.0, off_mm: float = 0.0, aside_mm: float = 0.0
) -> None:
    """North below x = `aside_mm`, each look telling the first light where it is, `off_mm` off."""
    light = watch.lights[0]
    for y in range(3_000, 7_000, 100):
        pose = Pose(aside_mm, float(y), heading_deg % 360.0)
        watch.add_pose(pose)
        watch.add_observation(
            _told(light.y_mm - y + off_mm) if abs(light.y_mm - y) < 500 else CeilingObservation(0, ()), pose
        )


def test_a_light_that_is_told_where_it_is() -> None:
    watch = _watch(NORTH)
    _drive(watch)
    assert watch.counts == LightDetection(
        passed=1, detected=1, in_view=9, in_view_reported=9, reported=9, false=0
    )
    assert watch.undetected == ()


def test_one_that_is_told_elsewhere_is_missed_and_false() -> None:
    watch = _watch(NORTH)
    _drive(watch, off_mm=MATCH_RADIUS_MM + 1.0)
    assert watch.counts == LightDetection(
        passed=1, detected=0, in_view=9, in_view_reported=0, reported=9, false=9
    )
    assert watch.undetected == (NORTH,)


def test_a_light_that_is_out_is_not_there() -> None:
    watch = _watch(replace(NORTH, brightness=0.0))
    _drive(watch)
    assert watch.counts == LightDetection(0, 0, 0, 0, reported=9, false=9)


@pytest.mark.parametrize(("heading_deg", "aside_mm"), [(0.0, 700.0), (40.0, 0.0), (90.0, 0.0)])
def test_beside_the_light_or_turned_away_nothing_is_due(heading_deg: float, aside_mm: float) -> None:
    watch = _watch(NORTH)
    _drive(watch, heading_deg, aside_mm=aside_mm)
    assert watch.counts.passed == watch.counts.in_view == 0


def test_a_lamp_has_no_front() -> None:
    watch = _watch(replace(NORTH, heading_deg=180.0))
    _drive(watch)
    assert watch.counts.detected == watch.counts.passed == 1


def test_the_detector_itself_sees_a_rendered_light() -> None:
    camera = CeilingCamera(replace(bare_scenery(np.zeros((0, 4)), seed=3), lights=(NORTH,)))
    watch = _watch(NORTH)
    for k, y in enumerate(range(3_000, 7_000, 125)):
        pose = Pose(60.0, float(y), 3.0)
        watch.add_pose(pose)
        lines = camera.rows(pose, k, UPWARD.scan_rows)
        watch.add_observation(CeilingObservation(k, ceiling_lights(lines, UPWARD, tilt_deg=3.0)), pose)
    counts = watch.counts
    assert counts.passed == counts.detected == 1
    assert counts.in_view == counts.in_view_reported > 4
    assert counts.reported >= counts.in_view
    assert counts.false == 0


def _result(counts: LightDetection) -> LightResult:
    return LightResult(
        key=RunKey("lights", 1, 1, "ours"), origin="350R", goal="376L", failure="", counts=counts,
        undetected=((1_000, -2_000),),
    )  # fmt: skip


def test_targets_and_tables() -> None:
    good = _result(LightDetection(1000, 995, 5000, 4990, 9000, 9))
    assert [target.met for target in light_targets([good])] == [True, True]
    bad = _result(LightDetection(1000, 994, 5000, 4990, 9000, 10))
    assert [target.met for target in light_targets([bad])] == [False, False]
    assert [target.met for target in light_targets([])] == [False, False]
    text = "\n".join(light_tables(published_list(), [good, bad]))
    assert "1989/2000" in text
    assert "19/18000" in text
    assert "1.0, -2.0" in text
    assert light_tables(published_list(), []) == []


def test_records_come_back_as_they_were() -> None:
    with Results(None, LIGHT_TABLE) as results:
        results.put(_result(LightDetection(6, 5, 4, 3, 2, 1)))
        assert results.select("lights", "ours") == (_result(LightDetection(6, 5, 4, 3, 2, 1)),)
