"""Lights as the simulator renders them, with all that can be wrong with a ceiling."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.stickrep.reader import load_map
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.hazards.scenery import CeilingLight, Scenery
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.scan_lines import ceiling_lights
from tests.paths import MAPS

MAP = MAPS / "msu_engineering_3.stickrep"
LOOK_S = 0.25
NEAR_MM = 1_500.0
AGREES_MM = 120.0
LIGHTS_A_SEED = 7
HEADING_SIGMA_DEG = 3.0


class Passage(NamedTuple):
    """A robot that goes below a light: aside of its middle, tilted, which it believes to be `off_deg` more,
    at a speed."""

    seed: int
    light: CeilingLight
    left_mm: float
    tilt_deg: float
    off_deg: float
    speed_mm_s: float
    back: bool
    phase: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """What was seen in a passage: was the light seen before the robot was below it, by how much were its
    places off, how many images were there, how many lights in them that are none."""

    detected: bool
    errors_mm: tuple[float, ...]
    images: int
    false: int


@cache
def floor() -> Map:
    return load_map(MAP)


def passages(seeds: range, hazards: Hazards) -> Iterator[tuple[Passage, Scenery, CeilingCamera]]:
    for seed in seeds:
        scenery = draw(hazards, floor(), seed)
        camera = CeilingCamera(scenery)
        rng = np.random.default_rng(seed)
        for number in rng.permutation(len(scenery.lights))[:LIGHTS_A_SEED].tolist():
            left, tilt, speed = rng.uniform((-800.0, -15.0, 150.0), (800.0, 15.0, 500.0)).tolist()
            back, phase = bool(rng.random() < 0.5), float(rng.random())
            off = float(rng.normal(0.0, HEADING_SIGMA_DEG))
            lamp = scenery.lights[number]
            yield Passage(seed, lamp, left, tilt, off, speed, back, phase), scenery, camera


def look_at(passage: Passage, scenery: Scenery, camera: CeilingCamera) -> Sight:
    """Pass below a light, looking as CTracker does."""
    heading = passage.light.heading_deg + 180.0 * passage.back
    ahead = -math.sin(math.radians(heading)), math.cos(math.radians(heading))
    believed = passage.tilt_deg + passage.off_deg
    way = passage.speed_mm_s * LOOK_S
    detected, errors, images, false = False, [], 0, 0
    for step in range(math.ceil(2 * NEAR_MM / way)):
        rest = NEAR_MM - (step + passage.phase) * way
        x = passage.light.x_mm - rest * ahead[0] - passage.left_mm * ahead[1]
        y = passage.light.y_mm - rest * ahead[1] + passage.left_mm * ahead[0]
        pose = (x, y, heading + passage.tilt_deg)
        lines = camera.rows(pose, passage.seed * 10**9 + round(step * LOOK_S * 1e9), UPWARD.scan_rows)
        images += 1
        for light in ceiling_lights(lines, UPWARD, tilt_deg=believed):
            off = min(
                (light.ahead_mm - (lamp.x_mm - x) * ahead[0] - (lamp.y_mm - y) * ahead[1]
                 for lamp in scenery.lights if lamp.brightness and _near(lamp, x, y)),
                key=abs, default=math.inf,
            )  # fmt: skip
            false += abs(off) > AGREES_MM
            if abs(light.ahead_mm - rest) <= AGREES_MM and light.whole:
                errors.append(light.ahead_mm - rest)
                detected |= rest > 0.0
    return Sight(detected=detected, errors_mm=tuple(errors), images=images, false=false)


def _near(lamp: CeilingLight, x: float, y: float) -> bool:
    return math.hypot(lamp.x_mm - x, lamp.y_mm - y) < NEAR_MM


@pytest.mark.long
def test_lights_that_are_on_are_seen_when_passing_and_nothing_else_is() -> None:
    seeds = range(50)
    print(f"seeds {seeds}")
    sights = [
        (passage, look_at(passage, scenery, camera))
        for passage, scenery, camera in passages(seeds, Hazards(light_out=0.2, light_dim=0.2, sunlit=0.4))
    ]
    on = [(passage, sight) for passage, sight in sights if passage.light.brightness > 0.0]
    missed = [passage for passage, sight in on if not sight.detected]
    images, false = (sum(getattr(sight, name) for _, sight in sights) for name in ("images", "false"))
    off = np.abs(np.concatenate([sight.errors_mm for _, sight in on]))
    print(
        f"{len(on)} lights, {len(missed)} missed; {images} images, {false} false lights; {off.mean():.1f} mm"
    )
    assert len(on) >= 250
    assert len(missed) <= 0.005 * len(on), missed
    assert false <= images / 1000
    assert np.percentile(off, 95) < 25.0


@pytest.mark.parametrize("sunlit", [0.0, 1.0])
def test_lights_that_are_out_are_not_seen(sunlit: float) -> None:
    seeds = range(100, 106)
    print(f"seeds {seeds}")
    hazards = Hazards(light_out=1.0, light_dim=0.0, sunlit=sunlit)
    sights = [look_at(*passage) for passage in passages(seeds, hazards)]
    images, false = sum(s.images for s in sights), sum(s.false for s in sights)
    print(f"{images} images, {false} false lights")
    assert images > 1000
    assert false <= images / 1000
