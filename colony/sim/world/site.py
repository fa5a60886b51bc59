"""The site of a plan: its floors in one run, a robot on one of them, and the elevators between them.

    site = Site(building, plan, Hazards(), seed=7)
    plant = Plant(site.world, clock, [site.elevators.advance])
    loop = Loop(behavior, simulated_drivers(plant), scripts, clock=clock, advance=plant.catch_up)

Hazards are drawn independently for each floor, from its own seed. Cameras follow the robot from floor to
floor.
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

_Camera = TypeVar("_Camera")


class Site:
    """The floors of a plan, with the robot at its start. Mutable: the world and the elevators.

    The attribute `building` has only the floors of the plan, in the order of the plan.

    Args:
        building: the building; the seed of each floor is `seed` plus its number.
        plan: the plan.
        hazards: the hazards of the floors.
        seed: seed of the hazards of the first floor.
        noise_seed: seed of the robot's own errors; by default `seed`.
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
        self.building = building.with_floors(plan.floors)
        self.maps: Mapping[str, Map] = {floor.name: floor for floor in self.building.maps}
        self.sceneries: Mapping[str, Scenery] = {
            name: draw(hazards, floor, seed=seed + numbers[name]) for name, floor in self.maps.items()
        }
        first_segment = plan.segments[0]
        self.world = World(
            walls=self.sceneries[first_segment.start.floor],
            poses=[(first_segment.start.x_mm, first_segment.start.y_mm, first_segment.heading_deg)],
            config=config,
            seed=seed if noise_seed is None else noise_seed,
        )
        self.elevators = Elevators(self.world, self.building, self.sceneries, first_segment.start.floor)

    @property
    def floor(self) -> str:
        """The name of the map of the floor with the robot."""
        return self.elevators.floor

    def camera_per_floor(self, build: Callable[[Map, Scenery], _Camera]) -> Callable[[], _Camera]:
        """Return a function that returns the camera of the robot's current floor, created on first use."""
        cameras: dict[str, _Camera] = {}

        def current_camera() -> _Camera:
            if self.floor not in cameras:
                cameras[self.floor] = build(self.maps[self.floor], self.sceneries[self.floor])
            return cameras[self.floor]

        return current_camera

    @cached_property
    def ceiling(self) -> Callable[[], CeilingCamera]:
        """A function that returns the camera that looks up on the robot's current floor."""
        return self.camera_per_floor(lambda _, scenery: CeilingCamera(scenery))
