"""Whether robots that roam touch anything, get away from what they touch, and stay off holes in the floor.

    python -m tools.roams --seeds 100 --workers 2
    python -m tools.roams --robot create2 --map loop --seeds 5

Each run begins at a place, and with a heading, of its seed. `wander` shall touch nothing and not
turn in circles. `bounce` feels its way: half of the walls are dark, so that it meets them with its bumper,
but it shall neither push on nor stay; and its wheels shall stay on a floor with holes, at places of the seed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from colony.dsl.load import load_file
from colony.experiment.parallel import PoolEngine
from colony.nav.maps.free_space import FreeSpace, Place
from colony.nav.maps.world_map import WorldMap, load_world
from colony.runs.behavior import Behavior, behavior_from
from colony.runs.described import DescribedRobot, described_robot
from colony.runtime.assembly.loop import Loop
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.config import config_of
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.hazards.scenery import bare_scenery
from colony.sim.world.movers import free_pose
from colony.sim.world.world import World
from tests.paths import MAPS, ROOT
from tools.roam_watch import LARGEST_HOLE_MM, Case, Roam, Watcher

ROBOTS = dict.fromkeys(("rome", "amr", "omni", "pioneer", "turtlebot"), "wander") | {"create2": "bounce"}
"""The robots, and what each of them runs."""

FLOORS = ("loop.stickrep", "atrium.stickrep", "narrow.stickrep", "office.yaml")

DURATION_S = 60.0

DARK = 0.5
"""Part of the walls that a robot with `bounce` feels, but does not see."""

HOLES = 8
HOLE_MM = (300.0, LARGEST_HOLE_MM)
FROM_HOLE_MM = 500.0
"""Least way from the hull of a robot at its start to a hole."""

PUSH_S = 0.2
"""Longest push: until the bumper is read, a frame has decided, and its command is carried out."""


def is_good(roam: Roam) -> bool:
    """Return whether a run is as it shall be."""
    if roam.case.behavior == "wander":
        return roam.got_away and not roam.contacts
    return roam.got_away and roam.pushed_s <= PUSH_S and not roam.rams and not roam.fell


@lru_cache(maxsize=8)
def _behavior(behavior: str, robot: str) -> tuple[Behavior, DescribedRobot]:
    program = load_file(ROOT / "behaviors" / f"{behavior}.colony", robot=robot)
    return behavior_from(program), described_robot(program.robot)


@lru_cache(maxsize=8)
def _floor(name: str) -> tuple[WorldMap, FreeSpace]:
    floor = load_world(MAPS / name)
    return floor, FreeSpace(floor)


def run(case: Case, duration_s: float = DURATION_S) -> Roam:
    """Run a robot, and return what became of it."""
    behavior, described = _behavior(case.behavior, case.robot)
    floor, space = _floor(case.floor)
    body, config = described.body, config_of(described.body)
    start = floor.start(config.radius_mm)
    pose = free_pose(space, start[:2], config.radius_mm + 50.0, [], number=0, seed=case.seed)
    feels = case.behavior == "bounce"
    scenery = bare_scenery(floor.walls, seed=case.seed, outlines=floor.has_outlines)
    if feels:
        dark = np.random.default_rng((case.seed, 8)).random(len(floor.walls)) < DARK
        scenery = replace(scenery, silent=dark)
    world = World(
        walls=scenery,
        poses=[pose],
        config=config,
        seed=case.seed,
        holes=_holes(space, start[:2], pose[:2], config.radius_mm, case.seed) if feels else (),
    )
    roam = Roam(case=case)
    watcher = Watcher(roam, world, config.wheel_base_mm, config.radius_mm)
    world.on_step(watcher.step)
    clock = VirtualClock()
    plant = Plant(world, clock)
    loop = Loop(
        behavior.robot,
        behavior.executor(),
        simulated_drivers(plant, body=body, servers=described.servers, seed=case.seed),
        {},
        clock=clock,
        advance=plant.catch_up,
        seed=case.seed,
        watch=watcher.take,
    )
    while loop.now_ns < duration_s * 1e9:
        loop.frame()
    watcher.finish()
    loop.close()
    return roam


def _holes(
    space: FreeSpace, start: Place, robot: Place, radius: float, seed: int
) -> list[NDArray[np.float64]]:
    """Draw rectangles without floor, not below the robot's start."""
    rng = np.random.default_rng((seed, 7))
    holes: list[NDArray[np.float64]] = []
    while len(holes) < HOLES:
        _, (x, y) = space.random_leg(start, 100.0, rng)
        width, depth = rng.uniform(*HOLE_MM, 2).tolist()
        gap = max(abs(x - robot[0]) - width / 2.0, abs(y - robot[1]) - depth / 2.0)
        if gap > radius + FROM_HOLE_MM:
            signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2.0
            holes.append(np.array([x, y]) + signs * (width, depth))
    return holes


# --- the table -------------------------------------------------------------------------------------------


def table(roams: Sequence[Roam]) -> str:
    """Return a table of runs by robot and floor, for pages."""
    rows = [
        "| robot | behavior | floor | runs | driven | contacts | fastest | longest push | longest contact "
        "| stuck | edges | beyond an edge | fell |",
        "|---" * 13 + "|",
    ]
    for robot, behavior, floor in sorted({roam.case[:3] for roam in roams}):
        some = [roam for roam in roams if roam.case[:3] == (robot, behavior, floor)]
        fields = (
            robot,
            behavior,
            floor.partition(".")[0],
            len(some),
            f"{sum(roam.way_mm for roam in some) / 1e6:.1f} km",
            sum(roam.contacts for roam in some),
            f"{max(roam.fastest_mm_s for roam in some):.0f} mm/s",
            f"{max(roam.pushed_s for roam in some):.2f} s",
            f"{max(roam.touched_s for roam in some):.2f} s",
            sum(not roam.got_away for roam in some),
            sum(roam.edges for roam in some),
            f"{max(roam.beyond_mm for roam in some):.0f} mm",
            sum(roam.fell for roam in some),
        )
        rows.append(f"| {' | '.join(map(str, fields))} |")
    return "\n".join(rows)


def main() -> None:
    """Run robots from the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.roams", description=__doc__.split("\n")[0])
    parser.add_argument("--robot", choices=ROBOTS, action="append", help="a robot; by default all")
    parser.add_argument(
        "--map", dest="floors", choices=[name.partition(".")[0] for name in FLOORS], action="append"
    )
    parser.add_argument("--seeds", type=int, default=25)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    floors = [name for name in FLOORS if not options.floors or name.partition(".")[0] in options.floors]
    cases = [
        Case(robot, ROBOTS[robot], floor, seed)
        for robot, floor, seed in product(options.robot or ROBOTS, floors, range(1, options.seeds + 1))
    ]
    roams = list(PoolEngine(options.workers).results(run, cases))
    print(table(roams))
    for roam in roams:
        if not is_good(roam):
            print(roam)
    sys.exit(not all(map(is_good, roams)))


if __name__ == "__main__":
    main()
