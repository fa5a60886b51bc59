"""The Clock dies and comes back: the robot stands meanwhile, and goes on with what it remembers."""

from __future__ import annotations

from functools import lru_cache
from random import Random

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from colony.execute.compiled import Compiled
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.observe.summary import Tally
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.world.world import World
from tests.paths import MAPS, ROOT
from tests.sampling import sampled

MS, S = 1_000_000, 1_000_000_000


@lru_cache
def navigator() -> Compiled:
    return compile_program(load_file(ROOT / "behaviors" / "navigator.colony")).compiled


def driven(goal_mm: float, *deaths: tuple[int, int]) -> tuple[float, int]:
    """How far the robot drove toward a goal, in mm, and how often all memory began anew.

    The Clock dies at the first time of each of `deaths`, and is back at the second.
    """
    length_ns = 8 * S + int(goal_mm * 4 * MS)
    clock, floor = VirtualClock(), load_map(MAPS / "loop.stickrep")
    pose = (floor.start.x_mm, floor.start.y_mm, floor.start.heading_deg)
    world = World(walls=walls_of(floor).segments, poses=[pose], seed=0)
    tally = Tally(navigator())
    session = VirtualSession(
        navigator(),
        simulated_drivers(Plant(world, clock), cameras=None),
        clock=clock,
        seed=0,
        variables={"GoalType": 68.0, "GoalDirection": 90.0, "GoalDistance": goal_mm},
        sinks=(tally,),
    )
    for death_ns, return_ns in deaths:
        session.transport.at(death_ns, lambda: session.kill("Clock"))
        session.transport.at(return_ns, lambda: session.restart("Clock"))
    session.run(length_ns)
    summary = tally.summary(seed=0, duration_s=length_ns / 1e9, interrupted=False, travel=None)
    assert not summary.disagreements
    return world.distance(0), summary.restarts


@lru_cache
def undisturbed(goal_mm: float) -> float:
    return driven(goal_mm)[0]


def check(goal_mm: float, seed: int) -> None:
    random = Random(seed)
    deaths = []
    for _ in range(random.choice((1, 1, 2))):
        death_ns = random.randrange(1 * S, int(goal_mm * 3 * MS))
        deaths.append((death_ns, death_ns + random.choice((1, 30, 200, 900, 1900)) * MS))
    distance, restarts = driven(goal_mm, *sorted(deaths))
    assert restarts == 0
    assert abs(distance - undisturbed(goal_mm)) < 100.0, deaths


@pytest.mark.parametrize("seed", range(2))
def test_a_navigator_drives_no_further_when_the_clock_dies(seed: int) -> None:
    check(1000.0, seed)


@pytest.mark.long
@pytest.mark.parametrize("seed", sampled(range(2, 16), every=5, thorough=True))
def test_a_navigator_never_drives_further_when_the_clock_dies(seed: int) -> None:
    check(5000.0, seed)
