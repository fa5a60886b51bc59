from __future__ import annotations

import math

import numpy as np
import pytest

from colony.nav.mapping.himm import Cells
from colony.nav.mapping.local_map import HoughParameters, WallLine, lines_in


def cells_along(
    *walls: tuple[float, float, float, float], jitter: float = 0.0, seed: int = 1, noise: int = 0
) -> Cells:
    """Cells of 100 mm along lines: the angle in degrees, the distance to the left, from and to, in mm."""
    random = np.random.default_rng(seed)
    ahead, left = [], []
    for angle, distance, begin, end in walls:
        along = np.arange(begin, end, 100.0)
        off = distance + jitter * random.standard_normal(len(along))
        cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        ahead.append(cosine * along - sine * off)
        left.append(sine * along + cosine * off)
    ahead.append(random.uniform(-3_000.0, 3_000.0, noise))
    left.append(random.uniform(-3_000.0, 3_000.0, noise))
    x, y = (np.floor(np.concatenate(part) / 100.0) * 100.0 + 50.0 for part in (ahead, left))
    certainty = np.full(len(x), 12.0)
    certainty[len(x) - noise :] = 3.0
    return Cells(x, y, certainty)


@pytest.mark.parametrize("angle", [-89.0, -45.0, -7.3, 0.0, 3.4, 30.0, 88.0])
def test_two_walls_are_found_better_than_to_a_bin(angle: float) -> None:
    cells = cells_along(
        (angle, 1_230.0, -1_500, 1_500), (angle, -1_270.0, -1_500, 1_500), jitter=20.0, noise=40
    )
    lines = lines_in(cells)
    assert len(lines) == 2
    for line in lines:
        # Along the grid a line of cells has steps: 100 mm on 3 m would be two degrees.
        assert abs(math.remainder(line.angle_deg - angle, 180.0)) < 1.2
        assert line.length_mm == pytest.approx(3_000.0, abs=250.0)
    assert sorted(abs(line.distance_mm) for line in lines) == pytest.approx([1_230.0, 1_270.0], abs=40.0)
    assert (
        lines[0].distance_mm
        * lines[1].distance_mm
        * math.cos(math.radians(lines[0].angle_deg - lines[1].angle_deg))
        < 0
    )


def test_angles_wrap_at_ninety() -> None:
    (line,) = lines_in(cells_along((90.0, 530.0, -1_000, 1_000)))
    assert abs(line.angle_deg) == pytest.approx(90.0, abs=0.5)
    assert -90.0 <= line.angle_deg < 90.0
    assert abs(line.distance_mm) == pytest.approx(530.0, abs=51.0)


def test_the_other_wall_is_sought_only_where_it_may_be() -> None:
    too_near = cells_along((0.0, 1_000.0, -1_500, 1_500), (0.0, 500.0, -1_500, 1_500))
    skew = cells_along((0.0, 1_000.0, -2_000, 2_000), (25.0, -1_000.0, -600, 600))
    far = cells_along((0.0, 1_000.0, -1_500, 1_500), (0.0, -5_000.0, -1_500, 1_500))
    assert [len(lines_in(cells)) for cells in (too_near, skew, far)] == [1, 1, 1]


def test_the_heavier_of_two_lines_leads() -> None:
    lines = lines_in(cells_along((0.0, 1_000.0, -2_000, 2_000), (60.0, -900.0, -700, 700)))
    assert lines[0].angle_deg == pytest.approx(0.0, abs=0.5)


def test_few_cells_are_no_line() -> None:
    assert lines_in(Cells(*(np.zeros(0) for _ in range(3)))) == ()
    assert lines_in(cells_along((0.0, 1_000.0, 0, 200))) == ()
    assert lines_in(cells_along((0.0, 1_000.0, 0, 500)), HoughParameters(min_length_mm=300.0)) != ()


def test_a_line_knows_its_length() -> None:
    assert WallLine(0.0, 0.0, 1.0, -500.0, 700.0, 1.0).length_mm == 1_200.0
