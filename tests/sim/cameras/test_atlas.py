"""Pictures on walls: a pixel sees the mean of the patch that it covers, computed here the long way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from colony.sim.cameras.atlas import AtlasPicture, atlas_of
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.optics import PINHOLE
from colony.sim.cameras.surfaces import PEOPLE, WallPicture, atlas_with, scene
from tests.sim.robots import FRONT_CAMERA

WIDE, HIGH = 1000.0, 600.0
EYE = 1350.0
DEPTH = 2000.0
FINE = 24
"""How many samples a side of a pixel the long way takes."""


def seen(picture: AtlasPicture, *, left: float = -500.0, top: float = EYE + 300.0) -> NDArray[np.uint8]:
    """A wall 2 m ahead with a picture that begins `left` to the right of straight ahead."""
    wall = [[-5000.0, DEPTH, 5000.0, DEPTH]]
    at = left + 5000.0
    end = at + picture.width_mm
    wall_pictures = WallPicture(0, at, end, top - picture.height_mm, top, PEOPLE, at)
    made = scene(wall, wall_pictures=[wall_pictures], atlas=atlas_with([picture]))
    made = made._replace(shades=np.zeros(1))
    camera = Camera(made, replace(FRONT_CAMERA, optics=PINHOLE), robot_radius_mm=400.0)
    return camera.image(np.array([[0.0, 0.0, 0.0]]), 0)


def by_samples(picture: AtlasPicture, left: float, top: float) -> NDArray[np.float64]:
    """The same image from many samples a pixel, in parts of the light that a white wall gives."""
    focal = 120.0 / np.tan(np.radians(30.0))
    columns = (np.arange(240 * FINE) + 0.5) / FINE - 120.0
    rows = (np.arange(120 * FINE) + 0.5) / FINE - 60.0
    x, y = columns * DEPTH / focal - left, top - EYE + rows * DEPTH / focal
    high, wide = picture.shades.shape
    column = np.floor(x / picture.width_mm * wide).astype(int)
    row = np.floor(y / picture.height_mm * high).astype(int)
    inside = ((row >= 0) & (row < high))[:, None] & ((column >= 0) & (column < wide))[None, :]
    opacity = np.ones_like(picture.shades) if picture.opacity is None else picture.opacity
    shades = (picture.shades * opacity)[np.clip(row, 0, high - 1)][:, np.clip(column, 0, wide - 1)]
    fine = np.where(inside, shades, 0.0)
    found: NDArray[np.float64] = fine.reshape(120, FINE, 240, FINE).mean(axis=(1, 3))
    return found


def light() -> NDArray[np.float64]:
    """What a white wall there looks like, column by column."""
    white = AtlasPicture(shades=np.ones((1, 1)), width_mm=6000.0, height_mm=2600.0)
    row: NDArray[np.float64] = seen(white, left=-3000.0, top=2650.0)[60].astype(float)
    return row + 0.5


@pytest.mark.parametrize("texel_mm", [2.0, 17.0, 200.0])
@pytest.mark.parametrize("left", [-500.0, -503.3, 120.7])
def test_a_pixel_is_the_mean_of_what_it_covers(texel_mm: float, left: float) -> None:
    rng = np.random.default_rng(3)
    shape = (round(HIGH / texel_mm), round(WIDE / texel_mm))
    picture = AtlasPicture(shades=rng.random(shape), width_mm=WIDE, height_mm=HIGH)
    expected = by_samples(picture, left, EYE + 300.0) * light()
    off = np.abs(seen(picture, left=left).astype(float) + 0.5 - expected)
    rows, columns = expected.shape
    wall = off[5 : rows - 5, 5 : columns - 5]
    assert wall.mean() < 1.2, f"off by {wall.mean():.2f} levels"
    assert wall.max() < 255.0 * 2.0 / FINE  # edges of texels lie between two samples, to either side


def test_what_a_picture_does_not_cover_is_seen() -> None:
    shades, opacity = np.full((10, 10), 1.0), np.zeros((10, 10))
    opacity[:, 5:] = 1.0
    picture = AtlasPicture(shades=shades, opacity=opacity, width_mm=WIDE, height_mm=HIGH)
    row = seen(picture)[60]
    assert (row[:118] == 0).all()
    assert row[121:160].min() > 100


def test_a_picture_that_repeats_goes_on() -> None:
    shades = np.array([[0.0] * 10 + [1.0] * 10])
    picture = AtlasPicture(shades=shades, width_mm=400.0, height_mm=2700.0, wraps=True)
    wall = [[-5000.0, DEPTH, 5000.0, DEPTH]]
    made = scene(wall, materials=[PEOPLE], atlas=atlas_with([picture]))
    camera = Camera(made, replace(FRONT_CAMERA, optics=PINHOLE), robot_radius_mm=400.0)
    row = camera.image(np.array([[0.0, 0.0, 0.0]]), 0)[60]
    steps = np.flatnonzero(np.abs(np.diff((row > 60).astype(int))))
    assert len(steps) >= 10
    pixels = 200.0 / DEPTH * 120.0 / np.tan(np.radians(30.0))
    assert np.diff(steps).mean() == pytest.approx(pixels, abs=0.1)


def test_a_wall_that_is_grazed_shows_the_mean() -> None:
    fine = np.indices((4, 2000)).sum(axis=0) % 2 * 1.0
    picture = AtlasPicture(shades=fine, width_mm=2000.0, height_mm=2700.0, wraps=True)
    made = scene([[-1000.0, -5000.0, -1000.0, 60_000.0]], materials=[PEOPLE], atlas=atlas_with([picture]))
    camera = Camera(made, replace(FRONT_CAMERA, optics=PINHOLE), robot_radius_mm=400.0)
    row = camera.image(np.array([[0.0, 0.0, 0.0]]), 0)[60, 60:115].astype(float)
    assert np.abs(np.diff(row, 2)).max() < 6.0  # no stripes where columns are much wider than texels


def test_an_atlas_keeps_the_numbers_of_pictures() -> None:
    pictures = [
        AtlasPicture(shades=np.full((2, n), 0.5), width_mm=10.0 * n, height_mm=20.0) for n in (1, 2, 3)
    ]
    atlas = atlas_of(pictures)
    assert atlas.pictures[:, 1].tolist() == [1.0, 2.0, 3.0]
    assert atlas.pictures[:, 3].tolist() == [10.0] * 3
    last = int(atlas.pictures[2, 0])
    assert atlas.sums[last:].max() == pytest.approx(3.0)
    assert len(atlas_of([]).pictures) == 0
