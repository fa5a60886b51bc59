"""Parameters of simulated robots, from their bodies."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.body.devices import Proximity
from colony.body.model import Body, Corner, Polygon
from colony.body.reader import body_of_text
from colony.body.shipped import shipped_body
from colony.sim.config import config_of, limits_of, rome_config, without_errors
from colony.sim.world.world import World
from tests.paths import ROOT
from tests.sim.robots import IDEAL, RING, ROME, pass_time, ring_of, with_ring

WALL = np.array([[-5000.0, 2000.0, 5000.0, 2000.0]])


def changed(**keys: str) -> Body:
    """The body of RoME with other texts for some of the keys of its ring."""
    text = (ROOT / "robots" / "rome" / "rome.toml").read_text(encoding="utf-8")
    for key, value in keys.items():
        line = next(line for line in text.splitlines() if line.split(" ")[0] == key)
        text = text.replace(line, f"{key} = {value}" if value else "", 1)
    found = body_of_text(text, "rome.toml")
    assert found.body is not None, found.diagnostics
    return found.body


def test_rome_is_made_from_its_body() -> None:
    body = shipped_body("rome")
    assert rome_config() == ROME
    assert config_of(body) == ROME
    assert (RING.channels, RING.ahead, RING.infrared_wired) == (24, 12, tuple(range(24)))
    assert (ROME.radius_mm, RING.ring_mm, ROME.wheel_base_mm) == (400.0, 360.0, 340.0)
    limits = limits_of(ROME)
    assert (limits.velocity, limits.turn) == (600.0, 90.0)
    assert (limits.acceleration, limits.turn_acceleration) == (800.0, 240.0)
    assert RING.sonar_noise == IDEAL.wheel_slip_mm == 0.0


@pytest.mark.parametrize("count", [4, 7, 16, 36])
def test_a_ring_has_as_many_elements_as_its_body_says(count: int) -> None:
    first = -360.0 / count * (count // 2)
    body = changed(count=str(count), bearing=f'"{first!r} deg"', step="", noise='"0 mm"', noise_fraction="0")
    config = config_of(body)
    assert (config.channels, ring_of(config).ahead) == (count, count // 2)
    world = World(walls=WALL, poses=[(0.0, 0.0, 0.0)], config=config)
    readings = world.sonar(0)
    assert readings.shape == world.infrared(0).shape == (count,)
    assert readings[count // 2] == pytest.approx(2000.0 - 360.0)
    assert readings[0] == (10_000.0)
    turned = World(walls=WALL, poses=[(0.0, 0.0, -360.0 / count)], config=config)
    assert turned.sonar(0)[count // 2 + 1] == pytest.approx(2000.0 - 360.0)


@pytest.mark.parametrize(
    "keys",
    [
        {"bearing": '"-170 deg"'},
        {"step": '"-15 deg"', "bearing": '"180 deg"'},
        {"step": '"10 deg"'},
    ],
)
def test_a_ring_that_the_simulator_does_not_know_is_refused(keys: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="expected one that closes"):
        config_of(changed(**keys))


def test_a_robot_without_a_ring_has_no_sonars_to_read() -> None:
    body = shipped_body("rome")
    servers = {n: s for n, s in body.servers.items() if not isinstance(s.simulated, Proximity)}
    config = config_of(replace(body, servers=servers))
    assert (config.ring, config.channels) == (None, 0)
    assert without_errors(config).ring is None
    world = World(walls=WALL, poses=[(0.0, 0.0, 0.0)], config=config)
    world.command(0, 300.0, 0.0)
    pass_time(world, 10.0)
    assert world.true_pose(0).y_mm == pytest.approx(1600.0, abs=1e-6)
    assert world.bumper(0).front
    with pytest.raises(ValueError, match="no ring of sonars"):
        world.sonar(0)
    with pytest.raises(ValueError, match="no ring of sonars"):
        world.infrared(0)


def test_two_rings_are_refused() -> None:
    body = shipped_body("rome")
    ring = next(s for s in body.servers.values() if isinstance(s.simulated, Proximity))
    with pytest.raises(ValueError, match="`rome` has 2 rings of sonars"):
        config_of(replace(body, servers={**body.servers, "Other": ring}))


def test_a_polygon_counts_as_the_circle_around_it() -> None:
    body = shipped_body("rome")
    corners = (Corner(300.0, 0.0), Corner(-300.0, 400.0), Corner(-300.0, -400.0))
    chassis = replace(body.chassis, footprint=Polygon(corners=corners))
    assert config_of(replace(body, chassis=chassis)).radius_mm == 500.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"radius_mm": 0.0},
        {"radius_mm": math.nan},
        {"radius_mm": 359.0},
        {"wheel_slip_mm": -1.0},
    ],
)
def test_nonsense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong)).split("_")[0]):
        replace(ROME, **wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        {"sonar_range_mm": math.inf},
        {"sonar_half_beam_deg": 90.0},
        {"sonar_critical_deg": 91.0},
        {"ring_mm": 401.0},
        {"infrared_wired": (0, 24)},
        {"ahead": 24},
    ],
)
def test_nonsense_in_a_ring_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong)).split("_")[0]):
        with_ring(ROME, **wrong)
