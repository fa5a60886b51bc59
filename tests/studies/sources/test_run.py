"""Runs that are driven with some of the sources of the pose, and the estimate held against the truth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from colony.experiment.results import Results, RunKey
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.pose import PoseEstimate
from colony.nav.pose.tracker import EVERY_SOURCE, PoseSource
from colony.runs.navigation import CEILING_CAMERA, SIDE_CAMERA
from colony.sim.hazards.hazards import Hazards
from studies.lists import PUBLISHED_MAP, ListedRun
from studies.runs import StudyRun
from studies.sources import run as sources
from studies.sources.results import (
    ALL_SOURCES,
    ODOMETRY,
    SOURCE_TABLE,
    PoseErrors,
    SourceOutcome,
    SourceResult,
    source_tables,
    source_targets,
)
from studies.sources.run import SOURCE_CHOICES, run_with_sources, source_list, with_comparison

KEY = RunKey("sources", 29, 1, "ours")
ESTIMATE = PoseEstimate(0, 1_000.0, 2_000.0, 359.0, 400.0, 0.0, 0.0, 900.0, 0.0, 1.0)


def result(*, good: int, failed: bool = False) -> SourceResult:
    best = SourceOutcome("", 20.0, 0.0, PoseErrors(100, 40_000.0, 9.0, 55.0, good))
    worst = SourceOutcome("stuck" if failed else "", 5_000.0, 80.0, PoseErrors(10, 1e7, 1e3, 2e3, 0))
    return SourceResult(key=KEY, origin="a", goal="b", outcomes={ALL_SOURCES: best, ODOMETRY: worst})


def test_each_source_is_left_out_once_and_all_of_them() -> None:
    assert SOURCE_CHOICES[ALL_SOURCES] == EVERY_SOURCE
    assert SOURCE_CHOICES[ODOMETRY] == frozenset()
    for source in (PoseSource.SONAR, PoseSource.LOCAL_MAPS, PoseSource.LIGHTS, PoseSource.PLATES):
        assert EVERY_SOURCE - {source} in SOURCE_CHOICES.values()


def test_the_runs_are_some_of_the_published_ones() -> None:
    assert [run.number for run in source_list()] == [1, 22, 24, 28, 35, 39]
    assert all(isinstance(run, ListedRun) and run.published is not None for run in source_list())


def test_an_estimate_is_held_against_the_true_pose_of_its_moment() -> None:
    errors = with_comparison(PoseErrors(), ESTIMATE, Pose(1_030.0, 1_960.0, 1.0))
    assert errors == pytest.approx((1, 2_500.0, 4.0, 50.0, 0))  # (3/2)^2 + (4/3)^2 + 2^2 = 8.03
    errors = with_comparison(errors, ESTIMATE, Pose(1_010.0, 2_000.0, 359.5))
    assert errors == pytest.approx((2, 2_600.0, 4.25, 50.0, 1))


@pytest.mark.thorough
def test_a_short_run_is_driven_with_each_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = StudyRun(
        key=KEY, map_path=PUBLISHED_MAP, origin="A339L", goal="A338R", hazards=Hazards.none(),
        cameras=frozenset({CEILING_CAMERA, SIDE_CAMERA}),
    )  # fmt: skip
    no_plates = EVERY_SOURCE - {PoseSource.PLATES}
    some = {ALL_SOURCES: EVERY_SOURCE, "no plates": no_plates, ODOMETRY: frozenset[PoseSource]()}
    monkeypatch.setattr(sources, "SOURCE_CHOICES", some)
    found = run_with_sources(spec)
    assert list(found.outcomes) == list(some)
    best, none = found.outcomes[ALL_SOURCES], found.outcomes[ODOMETRY]
    assert not best.failure
    assert best.errors.comparisons > 10
    assert math.sqrt(best.errors.square_mm2 / best.errors.comparisons) < 30.0
    assert best.errors.inside > 0.8 * best.errors.comparisons
    assert (
        none.errors.square_deg2 / none.errors.comparisons > best.errors.square_deg2 / best.errors.comparisons
    )


def test_results_come_back_as_they_were(tmp_path: Path) -> None:
    kept = result(good=95)
    with Results(tmp_path / "r.sqlite", SOURCE_TABLE) as results:
        results.put(kept)
        assert results.select("sources", "ours") == (kept,)


def test_the_tables_have_a_row_a_choice() -> None:
    other = replace(result(good=93, failed=True), key=KEY._replace(seed=2))
    told, targets, rows = source_tables(source_list(), [result(good=95), other])
    assert told == "Runs 29; seeds 1, 2."
    assert "94.0%" in targets
    assert "**missed**" not in targets
    assert [line.split("|")[1].strip() for line in rows.splitlines()[2:]] == [ALL_SOURCES, ODOMETRY]
    assert "2/2" in rows.splitlines()[2]
    assert "1/2" in rows.splitlines()[3]
    assert source_tables(source_list(), []) == []


@pytest.mark.parametrize(("good", "met"), [(100, False), (95, True), (80, False)])
def test_a_covariance_that_is_too_sure_or_not_sure_enough_misses_its_target(good: int, met: bool) -> None:
    assert source_targets([result(good=good)])[1].met is met
    assert source_targets([]) == ()
