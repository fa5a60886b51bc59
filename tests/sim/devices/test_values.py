"""Values that a body describes: constant, with noise, painted over the map."""

from __future__ import annotations

import statistics

import pytest

from tests.sim.devices.stage import Stage

PAINTED = """
[server.Nose.simulated]
device = "value"

[server.Nose.simulated.values.gas]
value      = "2 percent"
rectangles = [["-1 m", "5 m", "1 m", "2 m", "10 percent"]]
circles    = [["0 m", "0 m", "1 m", "82 percent"], ["0 m", "4 m", "500 mm", "30 percent"]]
edge       = "fading"

[server.Nose.simulated.values.wet]
value   = false
circles = [["0 m", "0 m", "1 m", true]]

[server.Nose.simulated.values.floor]
value      = "tiles"
members    = ["carpet", "tiles"]
rectangles = [["-1 m", "2 m", "1 m", "5 m", "carpet"]]

[server.Nose.simulated.values.voltage]
value = "12 V"
"""


@pytest.mark.parametrize(
    ("y_mm", "gas", "wet", "floor"),
    [
        (0.0, 0.82, True, 1.0),
        (250.0, 0.62, True, 1.0),
        (1000.0, 0.02, True, 1.0),
        (1001.0, 0.02, False, 1.0),
        (2000.0, 0.1, False, 0.0),
        (4000.0, 0.3, False, 0.0),
        (4250.0, 0.2, False, 0.0),
        (6000.0, 0.02, False, 1.0),
    ],
)
def test_values_are_those_painted_where_the_robot_is(
    y_mm: float, gas: float, wet: bool, floor: float
) -> None:
    stage = Stage(PAINTED, poses=[(0.0, y_mm, 0.0)])
    assert stage.read("Nose", "gas") == pytest.approx(gas)
    assert (stage.read("Nose", "wet"), stage.read("Nose", "floor")) == (wet, floor)
    assert stage.read("Nose", "voltage") == 12.0


def test_noise_is_drawn_for_each_time_field_and_robot() -> None:
    noisy = """
[server.Nose.simulated]
device = "value"
values = { a = { value = "5 m", noise = "10 mm" }, b = { value = "5 m", noise = "10 mm" } }
"""
    stage = Stage(noisy, poses=[(0.0, 0.0, 0.0), (9000.0, 0.0, 0.0)])
    rows = []
    for _ in range(400):
        stage.advance(0.05)
        rows.append(
            [float(str(stage.read("Nose", field, robot))) for robot in (0, 1) for field in ("a", "b")]
        )
        assert stage.read("Nose", "a") == rows[-1][0]
    for column in zip(*rows, strict=True):
        assert statistics.mean(column) == pytest.approx(5000.0, abs=2.0)
        assert statistics.stdev(column) == pytest.approx(10.0, rel=0.15)
    first, second, other, _ = zip(*rows, strict=True)
    assert abs(statistics.correlation(first, second)) < 0.2
    assert abs(statistics.correlation(first, other)) < 0.2


def test_what_is_given_replaces_a_value() -> None:
    stage = Stage(PAINTED, given=lambda server, field, now_ns: 0.5 if field == "gas" else None)
    assert stage.read("Nose", "gas") == 0.5
    assert stage.read("Nose", "voltage") == 12.0
