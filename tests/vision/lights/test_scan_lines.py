from __future__ import annotations

import math

import numpy as np
import pytest

from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.scan_lines import Lines, SeenLight, ceiling_lights, line_lights
from tests.vision.lights.corridors import Ceiling, rendered

LIT = Ceiling(lights=((0.0, 240.0),))


def lights_in(lines: Lines, tilt_deg: float = 0.0) -> tuple[SeenLight, ...]:
    return ceiling_lights(lines, UPWARD, tilt_deg=tilt_deg)


def one_in(lines: Lines, tilt_deg: float = 0.0) -> SeenLight:
    (light,) = lights_in(lines, tilt_deg)
    return light


def scan(ceiling: Ceiling, seed: int = 0, **where: float) -> Lines:
    return rendered(ceiling, np.random.default_rng(seed), **{"along_mm": 0.0, **where})  # type: ignore[arg-type]


@pytest.mark.parametrize("ahead", [-425.0, -203.7, 0.0, 101.3, 425.0])
def test_a_light_is_found_to_some_millimeters(ahead: float) -> None:
    light = one_in(scan(LIT, along_mm=-ahead))
    assert light.ahead_mm == pytest.approx(ahead, abs=4.0)
    assert (light.lines, light.whole) == (3, True)
    assert light.quality > 0.7


def test_without_noise_an_edge_is_found_to_a_part_of_a_pixel() -> None:
    still = Ceiling(lights=LIT.lights, noise=0.0, vignetting=0.0)
    for ahead in np.linspace(-400, 400, 41):
        assert abs(one_in(scan(still, along_mm=-ahead)).ahead_mm - ahead) < 0.2 * UPWARD.mm_per_column


@pytest.mark.parametrize("tilt", [-15.0, -7.0, 3.0, 15.0])
def test_the_edges_tell_the_tilt(tilt: float) -> None:
    light = one_in(scan(LIT, along_mm=-150.0, tilt_deg=tilt))
    assert light.tilt_deg == pytest.approx(tilt, abs=1.0)
    assert light.ahead_mm == pytest.approx(150.0, abs=6.0)


def test_a_light_that_one_line_sees_needs_to_be_told_the_tilt() -> None:
    lines = scan(LIT, along_mm=-100.0, left_mm=-700.0, tilt_deg=6.0)
    light = one_in(lines, tilt_deg=6.0)
    assert (light.lines, light.tilt_deg) == (1, None)
    assert light.ahead_mm == pytest.approx(100.0, abs=6.0)
    astray = one_in(lines).ahead_mm - light.ahead_mm
    assert astray == pytest.approx(UPWARD.left_of(30) * math.sin(math.radians(6.0)), abs=4.0)


@pytest.mark.parametrize("ahead", [600.0, 720.0, -600.0, -720.0])
def test_a_light_that_is_partly_out_of_view_has_one_edge(ahead: float) -> None:
    light = one_in(scan(LIT, along_mm=-ahead))
    assert not light.whole
    assert light.quality <= 0.5
    assert light.ahead_mm == pytest.approx(ahead, abs=6.0)


def test_a_line_alone_tells_the_edges_that_it_sees() -> None:
    whole, *_ = line_lights(scan(LIT), UPWARD)
    assert [(round(x.near_mm or 0, -1), round(x.far_mm or 0, -1)) for x in whole] == [(-300, 300)]
    partial, *_ = line_lights(scan(LIT, along_mm=-600.0), UPWARD)
    assert [(round(x.near_mm or 0, -1), x.far_mm) for x in partial] == [(300, None)]


@pytest.mark.parametrize(
    "ceiling",
    [
        Ceiling(lights=((0.0, 130.0),), level=70.0),
        Ceiling(lights=((0.0, 255.0),), level=215.0),
        Ceiling(lights=((0.0, 240.0),), bands=((-2000.0, -100.0, 170.0),)),
        Ceiling(lights=((0.0, 240.0),), noise=12.0),
        Ceiling(lights=((0.0, 240.0),), vignetting=0.45),
    ],
    ids=["dim", "sunny", "half in the sun", "noisy", "vignetting"],
)
def test_a_light_is_found_on_every_ceiling(ceiling: Ceiling) -> None:
    for seed in range(20):
        light = one_in(scan(ceiling, seed, along_mm=-50.0, left_mm=150.0, tilt_deg=-4.0))
        assert light.ahead_mm == pytest.approx(50.0, abs=15.0), seed
        assert light.lines >= 2


def test_what_is_no_light_is_none() -> None:
    seam = scan(Ceiling()).copy()
    for column in range(20, 240, 92):
        seam[:, column : column + 4] -= 18
    ramp = np.tile(np.clip(np.arange(240), 60, 200).astype(np.uint8), (3, 1))
    nothing = {
        "dark": scan(Ceiling()),
        "too long": scan(Ceiling(bands=((-400.0, 400.0, 240.0),))),
        "too short": scan(Ceiling(bands=((-200.0, 200.0, 240.0),))),
        "out": scan(Ceiling(lights=((0.0, 60.0),))),
        "seams": seam,
        "sunshine": ramp,
        "black": np.zeros((3, 240), dtype=np.uint8),
        "white": np.full((3, 240), 255, dtype=np.uint8),
    }
    assert {name: lights_in(lines) for name, lines in nothing.items()} == dict.fromkeys(nothing, ())


def test_lines_that_contradict_each_other_are_no_light_of_three_lines() -> None:
    shifted = np.stack([scan(LIT, along_mm=shift)[0] for shift in (0.0, 180.0, 0.0)])
    assert all(light.lines < 3 for light in lights_in(shifted))


def test_there_is_no_light_in_noise() -> None:
    seed = 20
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    images = rng.normal(90.0, 8.0, (2000, 3, 240)).clip(0, 255).astype(np.uint8)
    assert sum(bool(lights_in(image)) for image in images) == 0


def test_two_lights_in_view_are_two() -> None:
    pair = Ceiling(lights=((-420.0, 240.0), (420.0, 240.0)))
    assert sorted(round(light.ahead_mm, -1) for light in lights_in(scan(pair))) == [-420, 420]


def test_lines_of_another_camera_are_refused() -> None:
    with pytest.raises(ValueError, match=r"expected \(lines, 240\)"):
        line_lights(np.zeros((3, 320), dtype=np.uint8), UPWARD)
