"""Compasses: the heading, disturbed by the building, with an offset and noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from colony.sim.hazards.scenery import CompassDisturbance, bare_scenery
from tests.sim.devices.stage import Stage

NORTH = [(0.0, 0.0, 355.0)]


def compass(more: str = "") -> str:
    return f'[server.Compass]\nsimulated = {{ device = "compass"{more} }}\n'


def heading(stage: Stage) -> float:
    return stage.read("Compass", "heading")


def test_it_reads_the_heading_and_its_offset_within_a_turn() -> None:
    assert heading(Stage(compass(), poses=NORTH)) == 355.0
    assert heading(Stage(compass(', offset = "7 deg"'), poses=NORTH)) == pytest.approx(2.0)
    assert heading(Stage(compass(', offset = "-360 deg"'), poses=NORTH)) == pytest.approx(355.0)


def test_the_building_disturbs_it_place_by_place() -> None:
    field = CompassDisturbance(max_deg=20.0, spacing_mm=4000.0, seed=5)
    scenery = replace(bare_scenery(np.empty((0, 4))), compass_disturbance=field)
    stage = Stage(compass(), walls=scenery)
    errors = []
    for x in range(0, 40_000, 500):
        stage.world.place(0, (float(x), 0.0, 90.0))
        assert heading(stage) == stage.world.compass(0)
        errors.append(heading(stage) - 90.0)
    assert 5.0 < max(np.abs(errors)) <= 20.0
    assert np.abs(np.diff(errors)).max() < 10.0


def test_noise_is_normal_and_depends_on_the_seed_and_the_time_alone() -> None:
    noisy = compass(', noise = "2 deg"')
    often, once, other = (Stage(noisy, seed=seed, poses=NORTH) for seed in (3, 3, 4))
    found = []
    for _ in range(4000):
        for stage in (often, once, other):
            stage.world.advance(0.05)
        found.append((heading(often) - 355.0 + 180.0) % 360.0 - 180.0)
    assert heading(often) == heading(often) == heading(once) != heading(other)
    assert np.mean(found) == pytest.approx(0.0, abs=4.0 * 2.0 / math.sqrt(len(found)))
    assert np.std(found) == pytest.approx(2.0, rel=4.0 / math.sqrt(2 * len(found)))
