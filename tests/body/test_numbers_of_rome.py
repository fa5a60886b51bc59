"""The numbers of RoME are in its body alone: code of the simulator and of navigation has none of them."""

from __future__ import annotations

import ast
from dataclasses import MISSING, fields

import pytest

from colony.nav.mapping.himm import HimmParameters
from colony.nav.pose.echoes import SonarModel
from colony.sim.cameras.camera import CameraConfig
from colony.sim.cameras.ceiling import CeilingCameraConfig
from colony.sim.config import RingConfig, RobotConfig
from colony.vision.level_camera import LevelCamera
from colony.vision.lights.ceiling_camera import CeilingCameraModel
from tests.paths import ROOT

FILES = (
    "colony/sim/config.py",
    "colony/sim/sensors/sonar.py",
    "colony/sim/sensors/sonar.py",
    "colony/sim/devices/sensors.py",
    "colony/sim/devices/beams.py",
    "colony/sim/devices/device.py",
    "colony/sim/devices/actuators.py",
    "colony/sim/devices/ranging.py",
    "colony/sim/devices/robot.py",
    "colony/sim/drivers.py",
    "colony/sim/world/world.py",
    "colony/nav/pose/echoes.py",
    "colony/nav/mapping/himm.py",
    "studies/thesis/local_mapper.py",
    "colony/sim/cameras/camera.py",
    "colony/vision/level_camera.py",
    "colony/vision/lights/ceiling_camera.py",
)
NUMBERS = {24, 18, 15, 400, 340, 600, 800, 240, 10_000, 760, 1350, 0.003}
"""What RoME is known by; numbers that mean something else as well, such as 360, are left out."""

OTHERS = {
    "colony/nav/mapping/himm.py": {15},  # the greatest certainty of a cell
    "colony/vision/lights/ceiling_camera.py": {600},  # the length of a light
}
"""Numbers of files that are equal to one of RoME by chance."""


@pytest.mark.parametrize("file", FILES)
def test_code_has_no_number_of_rome(file: str) -> None:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    found = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    numbers = {value for value in found if isinstance(value, int | float) and not isinstance(value, bool)}
    assert not numbers & NUMBERS - OTHERS.get(file, set())


def test_what_is_of_the_robot_has_no_default() -> None:
    assert _defaults(LevelCamera) == set()
    assert _defaults(CeilingCameraModel) == {"ahead_mm", "left_mm"}
    assert _defaults(CameraConfig) == {"optics"}
    assert _defaults(CeilingCameraConfig) == {"blur_mm", "vignetting", "noise"}
    assert _defaults(RobotConfig) == _defaults(RingConfig) == set()
    assert _defaults(SonarModel) == {"reach_mm", "noise_mm", "noise_fraction", "oblique_mm"}
    assert _defaults(HimmParameters) == {"cell_mm", "half_side_mm", "reach_mm", "sonars"}


def _defaults(type_: type) -> set[str]:
    return {f.name for f in fields(type_) if f.default is not MISSING or f.default_factory is not MISSING}
