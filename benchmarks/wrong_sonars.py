"""How well robots keep to their way whose sonars are not what the local mapper believes.

The published runs are driven with all hazards, by robots whose sonars differ from `SonarModel`: a narrower or
wider cone, walls heard at smaller or larger angles, more noise, another ring. The mapper is not told.

    python -m benchmarks.wrong_sonars [EVERY [SEED]]

drives every so many of the forty runs (default 4) with each of the robots, which takes some minutes.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from benchmarks.arguments import whole_number
from colony.nav.maps.building import Building
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.plan.plan import Plan
from colony.nav.plan.route import plan
from colony.runs.behavior import behavior_of
from colony.runs.navigation import CEILING_CAMERA, PLANNER, navigation_scripts
from colony.runtime.assembly.loop import Loop
from colony.runtime.transport.virtual import VirtualClock
from colony.shipped import Shipped
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.config import RobotConfig, rome_config
from colony.sim.drivers import Plant, SimulatedCamera, simulated_drivers
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.shots import CeilingShot
from colony.sim.world.world import World
from studies.lists import PUBLISHED_MAP, published_list


def _with_ring(**changes: Any) -> RobotConfig:
    """RoME with changes to its ring."""
    rome = rome_config()
    assert rome.ring is not None
    return replace(rome, ring=replace(rome.ring, **changes))


ROBOTS: Mapping[str, RobotConfig] = {
    "as believed": rome_config(),
    "cone of 9 degrees": _with_ring(sonar_half_beam_deg=9.0),
    "cone of 15 degrees": _with_ring(sonar_half_beam_deg=15.0),
    "critical angle 20": _with_ring(sonar_critical_deg=20.0),
    "critical angle 45": _with_ring(sonar_critical_deg=45.0),
    "five times the noise": _with_ring(sonar_noise_mm=15.0, sonar_noise=0.015),
    "ring 30 mm smaller": _with_ring(ring_mm=330.0),
    "15, 45 and the noise": _with_ring(
        sonar_half_beam_deg=15.0,
        sonar_critical_deg=45.0,
        sonar_noise_mm=15.0,
        sonar_noise=0.015,
    ),
}
LOOK_FRAMES = 10
LONGEST_S = 1_500.0


class Errors(NamedTuple):
    """What a robot's belief was off by, twice a second: in mm, in degrees; whether the run came to its end,
    and the speed of its worst contact in mm/s."""

    off_mm: list[float]
    off_deg: list[float]
    ended: bool
    contact_mm_s: float


def drive(config: RobotConfig, way: Plan, seed: int) -> Errors:
    """One run."""
    floor = load_map(PUBLISHED_MAP)
    scenery, first = draw(Hazards(), floor, seed), way.segments[0]
    world = World(
        walls=scenery,
        poses=[(first.start.x_mm, first.start.y_mm, first.heading_deg)],
        config=config,
        seed=seed,
    )
    ceiling = CeilingCamera(scenery)
    clock = VirtualClock()
    plant = Plant(world, clock)
    camera = SimulatedCamera(plant, lambda now_ns: CeilingShot(ceiling, world, 0, now_ns))
    drivers = simulated_drivers(plant, cameras={CEILING_CAMERA: camera})
    scripts = navigation_scripts(way, Building(maps=(floor,)))
    behavior = behavior_of(Shipped.BEHAVIOR.path("navigator"))
    loop = Loop(
        behavior.robot,
        behavior.executor(),
        drivers,
        scripts,
        clock=clock,
        advance=plant.catch_up,
        seed=seed,
    )
    off_mm: list[float] = []
    off_deg: list[float] = []
    while not loop.scripts.has_ended(PLANNER) and loop.now_ns < LONGEST_S * 1e9:
        loop.frame()
        if loop.k % LOOK_FRAMES == 0:
            loop.base.refresh()
            true, believed = world.true_pose(0), loop.base.pose
            off_mm.append(math.hypot(true.x_mm - believed.x, true.y_mm - believed.y))
            off_deg.append(abs(math.remainder(true.heading_deg - believed.heading, 360.0)))
    loop.close()
    return Errors(off_mm, off_deg, loop.scripts.has_ended(PLANNER), world.contact_speed(0))


def ways(every: int) -> Iterator[Plan]:
    """The ways of the published runs, every so many of them."""
    floor = load_map(PUBLISHED_MAP)
    return (plan(floor, run.origin, run.goal) for run in published_list()[::every])


def main() -> None:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wrong_sonars")
    parser.add_argument("every", type=whole_number("step", 1), nargs="?", default=4, help="(default: 4)")
    parser.add_argument("seed", type=whole_number("seed", 0), nargs="?", default=1, help="(default: 1)")
    chosen = parser.parse_args()
    print(f"{'sonars':22} {'runs':>5} {'ended':>6} {'bumped':>7} {'p95 mm':>7} {'p95 deg':>8}")
    for name, config in ROBOTS.items():
        runs = [drive(config, way, chosen.seed + n) for n, way in enumerate(ways(chosen.every))]
        mm = np.percentile([off for run in runs for off in run.off_mm], 95)
        deg = np.percentile([off for run in runs for off in run.off_deg], 95)
        ended, bumped = sum(run.ended for run in runs), sum(run.contact_mm_s > 50.0 for run in runs)
        print(f"{name:22} {len(runs):5} {ended:6} {bumped:7} {mm:7.0f} {deg:8.2f}", flush=True)


if __name__ == "__main__":
    main()
