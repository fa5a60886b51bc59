"""A run with an additional script that measures the detection of ceiling lights."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import Any

from colony.experiment.lights.detection import LightDetectionMonitor
from colony.experiment.lights.results import LightResult
from colony.experiment.runs import Run, RunSpec
from colony.experiment.true_path import TruePath
from colony.nav.shared import GOAL_DIRECTION
from colony.robots.variants import CEILING_CAMERA
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, robot
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.observing import CeilingObservation, ceiling_observer, ensure_period
from colony.vision.periods import PERIOD_S


def light_probe(on_look: Callable[[CeilingObservation], None]) -> Script:
    """Look at the ceiling as often as CTracker, with its knowledge of the heading, and report each look."""
    yield from ensure_period((CEILING_CAMERA,), PERIOD_S)
    looks = ceiling_observer((CEILING_CAMERA,), (UPWARD,))
    while True:
        yield from sleep(PERIOD_S)
        for look in (yield from looks((yield from _tilt_deg()))):
            on_look(look)


def _tilt_deg() -> Generator[Step, Any, float]:
    """Return the robot's heading less the goal's; 0 if there is no goal yet."""
    try:
        direction = yield from do("DServer", data.get(GOAL_DIRECTION, type=float))
    except CallRefusedError:
        return 0.0
    position = yield from do("RServer", robot.position())
    return math.remainder(position.heading - direction, 360.0)


def run_with_light_probe(spec: RunSpec) -> LightResult:
    """Drive a run to its end, and count detections on its legs along ceiling lights."""
    looks: list[CeilingObservation] = []
    run = Run(spec, more={"witness": light_probe(looks.append)})
    watch, path = LightDetectionMonitor(run.scenery.lights), TruePath()
    try:
        running = True
        while running:
            pose = run.world.true_pose(0)
            path.add(run.loop.now_ns, pose)
            tracking = run.monitor.mode == "L"
            if tracking:
                watch.add_pose(pose)
            running = run.step()
            for look in looks:
                if tracking:
                    watch.add_observation(look, path.at(look.t_ns))
            looks.clear()
    finally:
        run.close()
    return LightResult(
        key=spec.key,
        origin=run.plan.origin,
        goal=run.plan.goal,
        failure=run.failure or "",
        counts=watch.counts,
        undetected=tuple((round(light.x_mm), round(light.y_mm)) for light in watch.undetected),
    )
