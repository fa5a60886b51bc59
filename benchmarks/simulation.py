"""How fast the simulator is: one robot, and a hundred in one world, in maps/loop.stickrep.

A step is 100 ms of simulated time: motion and collisions, then all 24 sonars, infrared detectors and bumpers
of each robot, read through the public interface. With hazards a frame is 50 ms, on the floor of the thesis's
experiments, with its people, open doors and joints; movers are twenty people in the loop. The peer is Stage:
57 us a step for one robot, 5.1 ms for a hundred, with 24 sonars of a single ray each, while a sonar here has
nine rays and walls are specular. amr has no sonars; in a step its lidar of 360 beams, its battery, lift,
button and cliff sensors are read. A fixed loop of plain Python and numpy is timed beside it, so that figures
of other machines can be compared. The occupancy grid is an office of 50 m by 50 m as SLAM would draw
it, with people who walk along its corridors.

    python -m benchmarks.simulation
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.nav.maps.free_space import FreeSpace
from colony.nav.maps.stickrep.geometry import corners, in_free_space
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.nav.maps.world_map import WorldMap, load_world
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.config import RobotConfig, config_of, rome_config
from colony.sim.devices import devices_of
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.hazards.scenery import CorridorTrack, Person, bare_scenery
from colony.sim.mechanism import nothing_given
from colony.sim.world.movers import with_movers
from colony.sim.world.world import World
from tests.nav.maps.grid.office import CORRIDOR, DEPTH, MARGIN, WALL, YAML, drawn_office

Row = dict[str, object]

STAGE_ONE_US = 57.0
STAGE_HUNDRED_US = 5100.0
TARGET_ONE_US = 2 * STAGE_ONE_US
TARGET_HUNDRED_US = STAGE_HUNDRED_US / 3
TARGET_AMR_US = 60.0
TARGET_HUNDRED_AMR_US = 2500.0
TARGET_READ_MS = 1000.0
TARGET_GRID_US = 60.0
TARGET_FRAME_US = 40.0
TARGET_IMAGE_US = 300.0
STEP_S = 0.1
FRAME_S = 0.05
REPEATS = 9
MOVERS = 20
SPACING_MM = 900.0
PEOPLE = 20
CELLS, CELL_MM = 1000, 50.0
CORRIDOR_MM = (MARGIN + WALL + DEPTH + CORRIDOR / 2) * CELL_MM
BAND_MM = (2 * DEPTH + CORRIDOR) * CELL_MM
"""From the top of the office to its first corridor, and from one corridor to the next."""

AMR = shipped_body("amr")

MAPS = Path(__file__).resolve().parent.parent / "maps"
LOOP, MSU = MAPS / "loop.stickrep", MAPS / "msu_engineering_3.stickrep"
TRACKED_ROWS = (30, 60, 90)


def world_of(robots: int, seed: int = 1, config: RobotConfig | None = None) -> World:
    """A world of robots spread over the corridors of the loop, with headings at random; RoMEs by default."""
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
    return World(walls=segments, poses=poses, seed=seed, config=config)


def _distance(segments: np.ndarray[tuple[int, ...], np.dtype[np.float64]], x: float, y: float) -> float:
    start, along = segments[:, :2] - (x, y), segments[:, 2:] - segments[:, :2]
    part = np.clip(-(start * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(start + part[:, None] * along).T).min())


def drive(world: World) -> None:
    """Command all robots: they back off, turning, where they bump."""
    for robot in range(len(world)):
        front, _ = world.bumper(robot)
        world.command(robot, -200.0 if front else 300.0, 60.0 if front else 5.0)


def step(world: World, time_s: float = STEP_S) -> None:
    """One step of all robots, reading all of their sensors."""
    drive(world)
    world.advance(time_s)
    for robot in range(len(world)):
        world.sonar(robot)
        world.infrared(robot)
        world.odometry(robot)


def amr_step(world: World) -> Callable[[], None]:
    """One step of robots with lidars, reading all of their devices."""
    servers = servers_of(AMR)
    read = [
        device
        for robot in range(len(world))
        for device in devices_of(AMR, servers, world, robot, seed=1, given=nothing_given).values()
    ]

    def one() -> None:
        drive(world)
        world.advance(STEP_S)
        now_ns = world.elapsed_ns
        for device in read:
            device.sense(now_ns)
        for robot in range(len(world)):
            world.odometry(robot)

    return one


def amr_rows() -> list[Row]:
    """Robots with lidars and other devices."""
    one, hundred = (world_of(robots, config=config_of(AMR)) for robots in (1, 100))
    one_us, hundred_us = median_us(amr_step(one), 500), median_us(amr_step(hundred), 20)
    notes = [f"{STEP_S / us * 1e6:,.0f} x real time" for us in (one_us, hundred_us)]
    return [
        _row("amr, one robot", one_us, "us/step", TARGET_AMR_US, notes[0]),
        _row("amr, 100 robots", hundred_us, "us/step", TARGET_HUNDRED_AMR_US, notes[1]),
    ]


def office_world(floor: WorldMap) -> World:
    """An amr in the corridor of an office, and people in all corridors."""
    rng = np.random.default_rng(1)
    corridors = [
        CorridorTrack(x_mm=1500.0, y_mm=y, heading_deg=270.0, length_mm=45_000.0, half_width_mm=1100.0)
        for y in (CELLS * CELL_MM - CORRIDOR_MM - k * BAND_MM for k in range(4))
    ]
    people = tuple(
        Person(
            track=corridors[number % 4],
            along_mm=float(rng.uniform(0.0, 45_000.0)),
            offset_mm=float(rng.uniform(-600.0, 600.0)),
            forward=bool(number % 2),
            speed_mm_s=1200.0,
        )
        for number in range(PEOPLE)
    )
    config, middle = config_of(AMR), (20_000.0, corridors[1].y_mm, 270.0)
    scenery = replace(bare_scenery(floor.walls, outlines=floor.has_outlines), people=people)
    return World(walls=scenery, poses=[floor.start(config.radius_mm, middle)], config=config, seed=1)


def grid_rows() -> list[Row]:
    """An occupancy grid: reading it and tracing its walls, and an amr in it among people."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "office.yaml"
        Image.fromarray(drawn_office(CELLS, CELLS, seed=1)).save(path.with_suffix(".png"))
        path.write_text(YAML.replace("-3.0, -14.4", "0.0, 0.0"))
        read_us = median_us(lambda: load_world(path), 1)
        floor = load_world(path)
    step_us = median_us(amr_step(office_world(floor)), 500)
    speed = f"{STEP_S / step_us * 1e6:,.0f} x real time"
    size = f"{CELLS} x {CELLS} cells, {len(floor.walls):,} walls"
    return [
        _row("grid, read and traced", read_us / 1000.0, "ms", TARGET_READ_MS, size),
        _row("amr in a grid, 20 people", step_us, "us/step", TARGET_GRID_US, speed),
    ]


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


def movers_rows() -> list[Row]:
    """A frame of one robot among people who walk between random places of the loop."""
    floor = load_world(LOOP)
    start = floor.start(rome_config().radius_mm)
    people = with_movers(bare_scenery(floor.walls), lambda: FreeSpace(floor), start[:2], MOVERS, seed=1)
    world = World(walls=people, poses=[start], seed=1)
    frame_us = median_us(lambda: step(world, FRAME_S), 500)
    note = f"{FRAME_S / frame_us * 1e6:,.0f} x real time"
    return [_row(f"one robot, {MOVERS} movers", frame_us, "us/frame", TARGET_FRAME_US, note)]


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
        *amr_rows(),
        *grid_rows(),
        *hazards_rows(),
        *movers_rows(),
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
