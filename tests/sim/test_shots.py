"""Shots of cameras in the fast loop: taken at once, drawn when somebody wants to see them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from colony.runtime.protocol.images import Shot
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.cameras.scene import scene_of
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.shots import CeilingShot, LevelShot
from colony.sim.world.world import World
from tests.buildings import LOOP
from tests.sim.robots import FRONT_CAMERA, IDEAL

SCENERY = draw(Hazards(person_spacing_mm=5000.0), LOOP, 2)


def staged() -> tuple[World, Camera]:
    world = World(walls=SCENERY, poses=[LOOP.start], config=IDEAL)
    return world, Camera(scene_of(LOOP, SCENERY), replace(FRONT_CAMERA, yaw_deg=90.0), robot_radius_mm=400.0)


def shots() -> list[Shot]:
    world, camera = staged()
    return [LevelShot(camera, world, 0, 5), CeilingShot(CeilingCamera(SCENERY), world, 0, 5)]


@pytest.mark.parametrize("shot", shots(), ids=["level", "ceiling"])
def test_a_band_is_a_part_of_the_whole_image(shot: Shot) -> None:
    assert (shot.height, shot.width, shot.channels) == (120, 240, 1)
    whole, band = shot.rows(0, 120), shot.rows(40, 41)
    assert (band.t_ns, band.height, band.width, band.first_row) == (5, 41, 240, 40)
    assert band.pixels == whole.pixels[40 * 240 : 81 * 240]
    assert len(set(whole.pixels)) > 10


@pytest.mark.parametrize(("first", "count"), [(-1, 3), (0, 0), (118, 3), (0, 121)])
@pytest.mark.parametrize("shot", shots(), ids=["level", "ceiling"])
def test_rows_that_an_image_does_not_have(shot: Shot, first: int, count: int) -> None:
    with pytest.raises(ValueError, match="expected at least 1 of rows 0 to 119"):
        shot.rows(first, count)


def test_a_shot_shows_the_moment_in_which_it_was_taken() -> None:
    world, camera = staged()
    shot = LevelShot(camera, world, 0, 5)
    at_once = camera.see(world, 0, 5)
    world.command(0, 400.0, 10.0)
    for _ in range(60):
        world.advance(0.05)
    late = np.frombuffer(shot.rows(0, 120).pixels, dtype=np.uint8).reshape(120, 240)
    assert (late == at_once).all()
    assert (camera.see(world, 0, 5) != at_once).mean() > 0.3
