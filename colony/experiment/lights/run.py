"""A run with an additional observer of the ceiling, which measures the detection of lights."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import Any

from colony.experiment.lights.detection import LightWatch
from colony.experiment.lights.results import LightResult
from colony.experiment.runs import Run, RunSpec
from colony.experiment.true_path import TruePath
from colony.nav.shared import GOAL_DIRECTION
from colony.robots.variants import CEILING_CAMERA
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, robot
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.looks import Look, cameras_looker, hurry
from colony.vision.periods import PERIOD_S


def light_witness(on_look: Callable[[Look], None]) -> Script:
    """Look at the ceiling as often as CTracker, with its knowledge of the heading, and report each look."""
    yield from hurry((CEILING_CAMERA,), PERIOD_S)
    looks = cameras_looker((CEILING_CAMERA,), (UPWARD,))
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


def run_with_witness(spec: RunSpec) -> LightResult:
    """Drive a run to its end, and count what is seen of the lights on its legs of lights."""
    looks: list[Look] = []
    driven = Run(spec, more={"witness": light_witness(looks.append)})
    watch, path = LightWatch(driven.scenery.lights), TruePath()
    try:
        going = True
        while going:
            pose = driven.world.true_pose(0)
            path.add(driven.loop.now_ns, pose)
            tracking = driven.watcher.mode == "L"
            if tracking:
                watch.moved(pose)
            going = driven.step()
            for look in looks:
                if tracking:
                    watch.looked(look, path.at(look.t_ns))
            looks.clear()
    finally:
        driven.close()
    return LightResult(
        key=spec.key,
        origin=driven.plan.origin,
        goal=driven.plan.goal,
        failure=driven.failure or "",
        counts=watch.counts,
        undetected=tuple((round(light.x_mm), round(light.y_mm)) for light in watch.undetected),
    )
