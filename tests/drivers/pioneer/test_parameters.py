"""The table of models."""

from __future__ import annotations

import pytest

from colony.drivers.pioneer.parameters import MODELS, parameters_of


def test_a_model_is_found_whatever_the_case() -> None:
    assert parameters_of("P3DX-SH") is parameters_of("p3dx-sh") is MODELS["p3dx-sh"]
    assert parameters_of("RESEARCHpb") is MODELS["researchpb"]
    assert parameters_of("labmate") is None


def test_a_p3dx_turns_about_the_middle_of_its_wheels() -> None:
    p3dx = MODELS["p3dx-sh"]
    assert p3dx.turn_rate(-100.0, 100.0) == pytest.approx(32.086, abs=1e-3)
    assert p3dx.turn_rate(100.0, 100.0) == 0.0


@pytest.mark.parametrize(
    ("model", "sonars"), [("p3dx-sh", 16), ("amigo-sh", 8), ("peoplebot-sh", 32), ("pion1x", 7)]
)
def test_sonars(model: str, sonars: int) -> None:
    poses = MODELS[model].sonars
    assert len(poses) == sonars
    assert len(set(poses)) == sonars


def test_a_p3dx_looks_to_all_sides() -> None:
    bearings = [pose.bearing for pose in MODELS["p3dx-sh"].sonars]
    assert bearings == [90, 50, 30, 10, -10, -30, -50, -90, -90, -130, -150, -170, 170, 150, 130, 90]
