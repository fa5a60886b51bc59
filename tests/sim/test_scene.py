"""Scenes: walls and what is on them, in the order that the renderer wants."""

from __future__ import annotations

import numpy as np
import pytest

from colony.nav.stickrep import EdgeKind
from colony.nav.walls import walls_of
from colony.sim.scene import Panel, scene, scene_of
from tests.sim.buildings import LOOP


def test_panels_lie_by_their_walls_in_the_order_given() -> None:
    walls = [[0.0, 0.0, 1000.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 500.0]]
    panels = [
        Panel(2, 0.0, 500.0, 0.0, 100.0, 0.1),
        Panel(0, 0.0, 1000.0, 0.0, 100.0, 0.2),
        Panel(1, 0.0, 1.0, 0.0, 1.0, 0.9),
        Panel(2, 100.0, 200.0, 0.0, 100.0, 0.3),
    ]
    made = scene(walls, panels, ceiling_mm=3000)
    assert len(made.walls) == 2  # what has no length is not seen
    assert made.first.tolist() == [0, 1, 3]
    assert made.panels[:, 4].tolist() == [0.2, 0.1, 0.3]
    assert made.ceiling == 3000.0


def test_a_scene_may_be_empty() -> None:
    assert scene([]).first.tolist() == [0]


def test_doors_of_a_map_have_a_leaf_in_a_frame() -> None:
    made, walls = scene_of(LOOP), walls_of(LOOP)
    assert len(made.walls) == len(walls.kinds)
    door = walls.kinds.index(EdgeKind.DOOR)
    frame, leaf = made.panels[made.first[door] : made.first[door + 1]]
    length = float(np.hypot(*(walls.segments[door, 2:] - walls.segments[door, :2])))
    assert frame[:2] == pytest.approx([0.0, length])
    assert leaf[:2] == pytest.approx([60.0, length - 60.0])
    assert leaf[3] < frame[3] < made.ceiling
    plain = walls.kinds.index(EdgeKind.WALL)
    assert made.first[plain + 1] - made.first[plain] == 1
