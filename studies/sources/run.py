"""The contribution of each source of the pose estimate: runs are repeated with one source left out.

Doors, people and slips stay the same, and the estimate is compared with the true pose along the path. The
paths have no elevators, and so no markers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import msgspec
import numpy as np

from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.pose import PoseEstimate, pose_of
from colony.nav.pose.tracker import EVERY_SOURCE, PoseSource
from colony.nav.shared import POSE
from colony.runs.navigation import CEILING_CAMERA, SIDE_CAMERA
from studies.lists import ListedRun, published_list
from studies.runs import Run, StudyRun
from studies.sources.results import ALL_SOURCES, ODOMETRY, PoseErrors, SourceOutcome, SourceResult

NUMBERS = (1, 22, 24, 28, 35, 39)
"""Numbers of the published runs to repeat.

In the old wing: a path along one corridor, one with two corners, and one with many. In the new wing: a short
path, a long one past dark corridors, and one with two corners.
"""

COMPARISON_INTERVAL = 10
"""Number of frames between two comparisons of the estimate."""

CHI_SQUARE_95 = 7.815
"""The 95 % quantile of the chi-square distribution with three degrees of freedom."""

_OMITTED_SOURCES = (PoseSource.SONAR, PoseSource.LOCAL_MAPS, PoseSource.LIGHTS, PoseSource.PLATES)

SOURCE_CHOICES: Mapping[str, frozenset[PoseSource]] = {
    ALL_SOURCES: EVERY_SOURCE,
    **{f"no {source.value.replace('-', ' ')}": EVERY_SOURCE - {source} for source in _OMITTED_SOURCES},
    "no sonar, no local maps": EVERY_SOURCE - {PoseSource.SONAR, PoseSource.LOCAL_MAPS},
    ODOMETRY: frozenset(),
}
"""The sources of each row, in addition to the odometry."""


def source_list() -> tuple[ListedRun, ...]:
    """Return a representative selection of the published runs."""
    return tuple(run for run in published_list() if run.number in NUMBERS)


def run_with_sources(spec: StudyRun) -> SourceResult:
    """Drive a run to its end, once for each choice of sources."""
    outcomes = {name: _outcome(_with_sources(spec, sources)) for name, sources in SOURCE_CHOICES.items()}
    return SourceResult(key=spec.key, origin=spec.origin, goal=spec.goal, outcomes=outcomes)


def _with_sources(spec: StudyRun, sources: frozenset[PoseSource]) -> StudyRun:
    """Return the run with these sources; without plates the robot has no side camera."""
    cameras = {CEILING_CAMERA, SIDE_CAMERA} if PoseSource.PLATES in sources else {CEILING_CAMERA}
    return replace(spec, sources=sources, cameras=frozenset(cameras))


def _outcome(spec: StudyRun) -> SourceOutcome:
    run, errors = Run(spec), PoseErrors()
    try:
        is_running = True
        while is_running:
            now_ns, k, true_pose = run.loop.now_ns, run.loop.k, run.world.true_pose(0)
            is_running = run.step()
            pose = _estimate(run) if k % COMPARISON_INTERVAL == 0 else None
            if pose is not None and pose.t_ns == now_ns:
                errors = with_comparison(errors, pose, true_pose)
    finally:
        run.close()
    return SourceOutcome(run.failure or "", run.goal_error_mm, run.world.contact_speed(0), errors)


def _estimate(run: Run) -> PoseEstimate | None:
    variables = run.loop.data.variables
    return pose_of(msgspec.msgpack.decode(variables.value(POSE).data)) if variables.has(POSE) else None


def with_comparison(errors: PoseErrors, pose: PoseEstimate, true_pose: Pose) -> PoseErrors:
    """Return the errors after another comparison of an estimate with the true pose of the same time."""
    x, y = true_pose.x_mm - pose.x_mm, true_pose.y_mm - pose.y_mm
    turn = math.remainder(true_pose.heading_deg - pose.heading_deg, 360.0)
    error = np.array([x, y, turn])
    covariance = np.array(
        [[pose.xx, pose.xy, pose.xh], [pose.xy, pose.yy, pose.yh], [pose.xh, pose.yh, pose.hh]]
    )
    distance = float(error @ np.linalg.solve(covariance, error))
    return PoseErrors(
        comparisons=errors.comparisons + 1,
        square_mm2=errors.square_mm2 + x * x + y * y,
        square_deg2=errors.square_deg2 + turn * turn,
        worst_mm=max(errors.worst_mm, math.hypot(x, y)),
        inside=errors.inside + (distance <= CHI_SQUARE_95),
    )
