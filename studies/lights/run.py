"""A run with an additional script that measures the detection of ceiling lights."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import Any

from colony.nav.shared import GOAL_DIRECTION
from colony.runs.navigation import CEILING_CAMERA
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, robot
from colony.vision.detections import PERIOD_S
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.observing import CeilingObservation, ceiling_observer, ensure_period
from studies.lights.detection import LightDetectionMonitor
from studies.lights.results import LightResult
from studies.runs import Run, StudyRun
from studies.true_path import TruePath


def light_probe(on_observation: Callable[[CeilingObservation], None]) -> Script:
    """Observe the ceiling as often as CTracker, with the same estimated tilt, and report each observation."""
    yield from ensure_period((CEILING_CAMERA,), PERIOD_S)
    observer = ceiling_observer((CEILING_CAMERA,), (UPWARD,))
    while True:
        yield from sleep(PERIOD_S)
        for observation in (yield from observer((yield from _tilt_deg()))):
            on_observation(observation)


def _tilt_deg() -> Generator[Step, Any, float]:
    """Return the robot's heading minus the goal's; 0 if there is no goal yet."""
    try:
        direction = yield from do("DServer", data.get(GOAL_DIRECTION, type=float))
    except CallRefusedError:
        return 0.0
    position = yield from do("RServer", robot.position())
    return math.remainder(position.heading - direction, 360.0)


def run_with_light_probe(spec: StudyRun) -> LightResult:
    """Drive a run to its end, and count the detections on its legs along ceiling lights."""
    observations: list[CeilingObservation] = []
    run = Run(spec, extra_scripts={"light probe": light_probe(observations.append)})
    monitor, path = LightDetectionMonitor(run.scenery.lights), TruePath()
    try:
        is_running = True
        while is_running:
            pose = run.world.true_pose(0)
            path.add(run.loop.now_ns, pose)
            tracking = run.monitor.mode == "L"
            if tracking:
                monitor.add_pose(pose)
            is_running = run.step()
            for observation in observations:
                if tracking:
                    monitor.add_observation(observation, path.at(observation.t_ns))
            observations.clear()
    finally:
        run.close()
    return LightResult(
        key=spec.key,
        origin=run.plan.origin,
        goal=run.plan.goal,
        failure=run.failure or "",
        counts=monitor.counts,
        undetected=tuple((round(light.x_mm), round(light.y_mm)) for light in monitor.undetected),
    )
