"""The site of a plan: its floors as they are in one run, a robot on one of them, the elevators between.

    site = Site(building, plan, Hazards(), seed=7)
    plant = Plant(site.world, clock, [site.elevators.advance])
    loop = Loop(behavior, simulated_drivers(plant), scripts, clock=clock, advance=plant.catch_up)

Hazards are drawn independently for each floor, from a seed of its own. Cameras ask for the floor on which the
robot is at the moment.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TypeVar

from colony.nav.maps.building import Building
from colony.nav.maps.stickrep.model import Map
from colony.nav.plan.plan import Plan
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.config import RobotConfig
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.hazards.scenery import Scenery
from colony.sim.world.elevators import Elevators
from colony.sim.world.world import World

_Eye = TypeVar("_Eye")


class Site:
    """The floors of a plan, and the robot at its beginning. Mutable: the world, the elevators.

    `building` has only those floors, the one first on which the plan begins.

    Args:
        building: the building; its first floor is drawn from `seed`, and each other one from that plus its
            number.
        plan: the plan; the site has only the floors through which it leads.
        hazards: the hazards of the floors.
        seed: seed of the floors.
        noise_seed: seed of the robot's own errors; by default that of the floors.
        config: the parameters of the robot.
    """

    def __init__(
        self,
        building: Building,
        plan: Plan,
        hazards: Hazards,
        *,
        seed: int,
        noise_seed: int | None = None,
        config: RobotConfig | None = None,
    ) -> None:
        numbers = {floor.name: number for number, floor in enumerate(building.maps)}
        self.building = building.part(plan.floors)
        self.maps: Mapping[str, Map] = {floor.name: floor for floor in self.building.maps}
        self.sceneries: Mapping[str, Scenery] = {
            name: draw(hazards, floor, seed=seed + numbers[name]) for name, floor in self.maps.items()
        }
        first = plan.segments[0]
        self.world = World(
            walls=self.sceneries[first.start.floor],
            poses=[(first.start.x_mm, first.start.y_mm, first.heading_deg)],
            config=config,
            seed=seed if noise_seed is None else noise_seed,
        )
        self.elevators = Elevators(self.world, self.building, self.sceneries, first.start.floor)

    @property
    def floor(self) -> str:
        """The name of the map of the floor on which the robot really is."""
        return self.elevators.floor

    def eyes(self, made: Callable[[Map, Scenery], _Eye]) -> Callable[[], _Eye]:
        """Return a function that gives the camera of the robot's present floor; made when first wanted."""
        kept: dict[str, _Eye] = {}

        def here() -> _Eye:
            if self.floor not in kept:
                kept[self.floor] = made(self.maps[self.floor], self.sceneries[self.floor])
            return kept[self.floor]

        return here

    @cached_property
    def ceiling(self) -> Callable[[], CeilingCamera]:
        """The camera that looks up, as `eyes` gives it."""
        return self.eyes(lambda _, scenery: CeilingCamera(scenery))
