"""How fast the simulator is: one robot, and a hundred in one world, in maps/loop.stickrep.

A step is 100 ms of simulated time: motion and collisions, then all 24 sonars, infrared detectors and bumpers
of each robot, read through the public interface. With hazards a frame is 50 ms, on the floor of the thesis's
experiments, with its people, open doors and joints. The peer is Stage: 57 us a step for one robot, 5.1 ms for
a hundred, with 24 sonars of a single ray each, while a sonar here has nine rays and walls are specular. A
fixed loop of plain Python and numpy is timed beside it, so that figures of other machines can be compared.

    python -m benchmarks.simulation
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from colony.nav.maps.stickrep.geometry import corners, in_free_space
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.world.world import World

Row = dict[str, object]

STAGE_ONE_US = 57.0
STAGE_HUNDRED_US = 5100.0
TARGET_ONE_US = 2 * STAGE_ONE_US
TARGET_HUNDRED_US = STAGE_HUNDRED_US / 3
TARGET_FRAME_US = 40.0
TARGET_IMAGE_US = 300.0
STEP_S = 0.1
FRAME_S = 0.05
REPEATS = 9
SPACING_MM = 900.0

MAPS = Path(__file__).resolve().parent.parent / "maps"
LOOP, MSU = MAPS / "loop.stickrep", MAPS / "msu_engineering_3.stickrep"
TRACKED_ROWS = (30, 60, 90)


def world_of(robots: int, seed: int = 1) -> World:
    """A world of robots spread over the corridors of the loop, with headings at random."""
    floor = load_map(LOOP)
    segments = walls_of(floor).segments
    outlines = tuple(corners(ring) for ring in floor.rings)
    low_x, low_y, high_x, high_y = walls_of(floor).bounds
    free = [
        (x, y)
        for x in np.arange(low_x + SPACING_MM / 2, high_x, SPACING_MM)
        for y in np.arange(low_y + SPACING_MM / 2, high_y, SPACING_MM)
        if in_free_space(outlines, x, y) and _distance(segments, x, y) > SPACING_MM / 2 - 1e-6
    ]
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(free), size=robots, replace=False)
    poses = [(*free[i], rng.uniform(0.0, 360.0)) for i in chosen]
    return World(walls=segments, poses=poses, seed=seed)


def _distance(segments: np.ndarray[tuple[int, ...], np.dtype[np.float64]], x: float, y: float) -> float:
    start, along = segments[:, :2] - (x, y), segments[:, 2:] - segments[:, :2]
    part = np.clip(-(start * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(start + part[:, None] * along).T).min())


def step(world: World, time_s: float = STEP_S) -> None:
    """One step of all robots, reading all of their sensors; they back off, turning, where they bump."""
    for robot in range(len(world)):
        front, _ = world.bumper(robot)
        world.command(robot, -200.0 if front else 300.0, 60.0 if front else 5.0)
    world.advance(time_s)
    for robot in range(len(world)):
        world.sonar(robot)
        world.infrared(robot)
        world.odometry(robot)


def hazards_rows() -> list[Row]:
    """A frame with all hazards, and the camera that looks up: all of its image, and three rows."""
    floor = load_map(MSU)
    scenery = draw(Hazards(), floor, 1)
    world = World(walls=scenery, poses=[floor.start], seed=1)
    camera, light = CeilingCamera(scenery), scenery.lights[1]
    below = (light.x_mm + 200.0, light.y_mm - 100.0, light.heading_deg + 5.0)
    frame_us = median_us(lambda: step(world, FRAME_S), 500)
    image_us = median_us(lambda: camera.image(below, 0), 50)
    rows_us = median_us(lambda: camera.rows(below, 0, TRACKED_ROWS), 500)
    return [
        _row(
            "one robot, hazards",
            frame_us,
            "us/frame",
            TARGET_FRAME_US,
            f"{FRAME_S / frame_us * 1e6:,.0f} x real time",
        ),
        _row("ceiling image", image_us, "us", TARGET_IMAGE_US, "240 x 120, below a light"),
        _row("ceiling, three rows", rows_us, "us", None, "what the light tracker reads"),
    ]


def calibration() -> None:
    """A fixed piece of work: a sum in Python, and products of small matrices in numpy."""
    total = 0
    for i in range(20_000):
        total += i * i
    matrix = np.full((32, 32), 0.5)
    for _ in range(100):
        matrix = matrix @ matrix / 16.0


def median_us(work: Callable[[], object], times: int) -> float:
    """Microseconds a call: the median of several repeats of `times` calls, after one that is not counted."""
    measured = []
    for _ in range(REPEATS + 1):
        begin = time.perf_counter()
        for _ in range(times):
            work()
        measured.append((time.perf_counter() - begin) / times * 1e6)
    return statistics.median(measured[1:])


def run() -> list[Row]:
    """Measure; a row has name, value, unit, target, ok and note. `target` is the most that `value` may be."""
    one, hundred = world_of(1), world_of(100)
    yardstick = median_us(calibration, 10)
    one_us = median_us(lambda: step(one), 500)
    hundred_us = median_us(lambda: step(hundred), 20)
    return [
        _row("calibration loop", yardstick, "us", None, "20,000 additions in Python, 100 products in numpy"),
        _row("one robot", one_us, "us/step", TARGET_ONE_US, f"{STEP_S / one_us * 1e6:,.0f} x real time"),
        _row("one robot / Stage", one_us / STAGE_ONE_US, "ratio", 2.0, f"Stage: {STAGE_ONE_US:g} us/step"),
        _row(
            "100 robots",
            hundred_us,
            "us/step",
            TARGET_HUNDRED_US,
            f"{STEP_S / hundred_us * 1e6:,.0f} x real time",
        ),
        _row(
            "100 robots / Stage",
            hundred_us / STAGE_HUNDRED_US,
            "ratio",
            1 / 3,
            f"Stage: {STAGE_HUNDRED_US:g} us/step",
        ),
        _row("one robot / calibration loop", one_us / yardstick, "ratio", None, "for other machines"),
        *hazards_rows(),
    ]


def _row(name: str, value: float, unit: str, target: float | None, note: str) -> Row:
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


def main() -> None:
    """Print the figures as a table."""
    line = "{:30} {:>10} {:>10}  {:8} {:4} {}".format
    print(line("simulation", "value", "target", "unit", "", "note"))
    for row in run():
        target = "" if row["target"] is None else f"{row['target']:.4g}"
        verdict = "ok" if row["ok"] else "MISS"
        print(line(row["name"], f"{row['value']:.4g}", target, row["unit"], verdict, row["note"]))


if __name__ == "__main__":
    main()
