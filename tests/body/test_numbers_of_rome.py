"""The numbers of RoME are in its body alone: code of the simulator and of navigation has none of them."""

from __future__ import annotations

import ast
from dataclasses import MISSING, fields

import pytest

from colony.nav.mapping.himm import HimmParameters
from colony.nav.pose.echoes import SonarModel
from colony.sim.config import RobotConfig
from tests.paths import ROOT

FILES = (
    "colony/sim/config.py",
    "colony/sim/sensors/sonar.py",
    "colony/sim/world/world.py",
    "colony/nav/pose/echoes.py",
    "colony/nav/mapping/himm.py",
    "colony/nav/mapping/local_mapper.py",
)
NUMBERS = {24, 18, 15, 400, 340, 600, 800, 240, 10_000, 760, 1350, 0.003}
"""What RoME is known by; numbers that mean something else as well, such as 360, are left out."""


@pytest.mark.parametrize("file", FILES)
def test_code_has_no_number_of_rome(file: str) -> None:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    allowed = {15} if file.endswith("himm.py") else set()  # there the greatest certainty of a cell
    found = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    numbers = {value for value in found if isinstance(value, int | float) and not isinstance(value, bool)}
    assert not numbers & (NUMBERS - allowed)


def test_what_is_of_the_robot_has_no_default() -> None:
    assert all(f.default is MISSING and f.default_factory is MISSING for f in fields(RobotConfig))
    defaults = {f.name for f in fields(SonarModel) if f.default is not MISSING}
    assert defaults == {"reach_mm", "noise_mm", "noise_fraction", "oblique_mm"}
    assert {f.name for f in fields(HimmParameters) if f.default is not MISSING} == {
        "cell_mm",
        "half_side_mm",
        "reach_mm",
    }
