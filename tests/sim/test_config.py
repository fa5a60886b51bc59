from __future__ import annotations

import math

import pytest

from colony.sim.config import IDEAL, RobotConfig


def test_the_default_robot_is_sound() -> None:
    assert RobotConfig().infrared_wired == tuple(range(24))
    assert IDEAL.sonar_noise == IDEAL.wheel_slip_mm == 0.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"radius_mm": 0.0},
        {"radius_mm": math.nan},
        {"sonar_range_mm": math.inf},
        {"wheel_slip_mm": -1.0},
        {"sonar_half_beam_deg": 90.0},
        {"sonar_critical_deg": 91.0},
        {"sonar_ring_mm": 401.0},
        {"infrared_wired": (0, 24)},
    ],
)
def test_nonsense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong)).split("_")[0]):
        RobotConfig(**wrong)
