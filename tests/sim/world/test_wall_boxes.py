"""Boxes around walls change nothing of what robots sense and where they go."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import colony.sim.world.world as module
from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.ir.types import Value
from colony.nav.maps.world_map import load_world
from colony.sim.config import config_of
from colony.sim.devices import devices_of
from colony.sim.hazards.scenery import bare_scenery
from colony.sim.mechanism import nothing_given
from colony.sim.sensors.sonar import wall_table
from colony.sim.world.placing import GROUP, HIGH_X, HIGH_Y, IS_OUTLINE, LOW_X, LOW_Y, wall_boxes
from colony.sim.world.world import World
from tests.paths import MAPS

Floats = NDArray[np.float64]


def unbounded(walls: Floats, *, outlines: bool = False) -> Floats:
    """Boxes by which no wall is passed over."""
    boxes = wall_boxes(walls)
    boxes[:, [LOW_X, LOW_Y]], boxes[:, [HIGH_X, HIGH_Y]] = -np.inf, np.inf
    return boxes


def test_each_box_holds_its_walls() -> None:
    walls = wall_table(np.random.default_rng(1).uniform(-1e4, 1e4, (3 * GROUP + 5, 4)))
    boxes = wall_boxes(walls, outlines=True)
    assert boxes.shape == (4, 5)
    for wall, (x0, y0, x1, y1) in enumerate(walls[:, :4]):
        low_x, low_y, high_x, high_y, is_outline = boxes[wall // GROUP]
        assert low_x < min(x0, x1) <= max(x0, x1) < high_x
        assert low_y < min(y0, y1) <= max(y0, y1) < high_y
        assert is_outline == 1.0
    assert wall_boxes(walls[:0]).shape == (0, 5)
    assert (wall_boxes(walls)[:, IS_OUTLINE] == 0.0).all()


def driven(robot: str, map_name: str) -> list[Value]:
    """What a robot senses that drives about and bumps into walls."""
    floor, body = load_world(MAPS / map_name), shipped_body(robot)
    config = config_of(body)
    world = World(walls=floor.walls, poses=[floor.start(config.radius_mm)], config=config, seed=3)
    sensed: list[Value] = []
    devices = devices_of(body, servers_of(body), world, 0, seed=1, given=nothing_given)
    for _ in range(150):
        front, rear = world.bumper(0)
        world.command(0, -400.0 if front else 600.0, 70.0 if front or rear else 9.0)
        world.advance(0.1)
        sensed += [(*world.true_pose(0), *world.odometry(0), float(front), float(rear))]
        if config.channels:
            sensed += [tuple(world.sonar(0).tolist())]
        if "Lidar" in devices:
            sensed += [devices["Lidar"].sense(world.elapsed_ns)["scan"].value]
    assert world.bumps(0) > 0
    return sensed


@pytest.mark.parametrize(
    ("robot", "map_name"), [("amr", "loop.stickrep"), ("rome", "loop.stickrep"), ("rome", "office.yaml")]
)
def test_a_run_is_the_same_bit_for_bit(robot: str, map_name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    by_boxes = driven(robot, map_name)
    monkeypatch.setattr(module, "wall_boxes", unbounded)
    assert driven(robot, map_name) == by_boxes


def test_outlines_are_seen_as_walls_of_two_sides() -> None:
    """The noise of a beam depends on nothing but the seed, so equal distances give equal ranges."""
    floor, body = load_world(MAPS / "office.yaml"), shipped_body("amr")
    config = config_of(body)
    scans = []
    places = [(x * 700.0, y * 690.0, 37.0 * x + y) for x in range(30) for y in range(-20, 9)]
    for outlines in (True, False):
        scenery = bare_scenery(floor.walls, outlines=outlines)
        world = World(walls=scenery, poses=[floor.start(config.radius_mm)], config=config)
        lidar = devices_of(body, servers_of(body), world, 0, seed=1, given=nothing_given)["Lidar"]
        found = []
        for place in places:
            try:
                floor.start(config.radius_mm, place)
                world.place(0, place)
            except ValueError:
                continue
            world.advance(0.1)
            found.append(lidar.sense(world.elapsed_ns)["scan"].value)
        scans.append(np.array(found))
    assert len(scans[0]) > 200
    differs = ~np.isclose(*scans, rtol=0.0, atol=1e-6)
    assert differs.mean() < 1e-5, np.argwhere(differs)[:10]
