"""The site of a run: floors of a building, robots on one of them, and the elevators between them.

    site = Site(building, plan.floors, Hazards(), poses=[plan.start], seed=7)
    plant = Plant(site.world, clock, [site.elevators.advance])
    loop = Loop(behavior, simulated_drivers(plant), scripts, clock=clock, advance=plant.catch_up)

Hazards are drawn independently for each floor, from its own seed. Cameras follow the robots from floor to
floor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

from colony.nav.maps.building import Building
from colony.nav.maps.stickrep.model import Map
from colony.sim.config import RobotConfig
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.hazards.scenery import Scenery
from colony.sim.world.elevators import Elevators
from colony.sim.world.world import World

if TYPE_CHECKING:  # compiled when it is imported, which robots without cameras do not wait for
    from colony.sim.cameras.ceiling import CeilingCamera

_Camera = TypeVar("_Camera")


class SimulatedSite:
    """Floors of a building, with robots on the first of them. Mutable: the world and the elevators.

    The attribute `building` has only these floors, in this order.

    Args:
        building: the building; the seed of each floor is `seed` plus its number.
        floors: the names of the maps of the floors, the robots' one first.
        hazards: the hazards of the floors.
        poses: the initial poses of the robots, x and y in mm and the heading in degrees.
        seed: seed of the hazards of the building's first floor.
        noise_seed: seed of the robots' own errors; by default `seed`.
        config: the parameters of the robots.
    """

    def __init__(
        self,
        building: Building,
        floors: Sequence[str],
        hazards: Hazards,
        *,
        poses: Sequence[tuple[float, float, float]],
        seed: int,
        noise_seed: int | None = None,
        config: RobotConfig | None = None,
    ) -> None:
        numbers = {floor.name: number for number, floor in enumerate(building.maps)}
        self.building = building.with_floors(floors)
        self.maps: Mapping[str, Map] = {floor.name: floor for floor in self.building.maps}
        self.sceneries: Mapping[str, Scenery] = {
            name: draw(hazards, floor, seed=seed + numbers[name]) for name, floor in self.maps.items()
        }
        self.world = World(
            walls=self.sceneries[floors[0]],
            poses=poses,
            config=config,
            seed=seed if noise_seed is None else noise_seed,
        )
        self.elevators = Elevators(self.world, self.building, self.sceneries, floors[0])

    @property
    def floor(self) -> str:
        """The name of the map of the floor with the robots."""
        return self.elevators.floor

    def camera_per_floor(self, build: Callable[[Map, Scenery], _Camera]) -> Callable[[], _Camera]:
        """Return a function that returns the camera of the robots' current floor, created on first use."""
        cameras: dict[str, _Camera] = {}

        def current_camera() -> _Camera:
            if self.floor not in cameras:
                cameras[self.floor] = build(self.maps[self.floor], self.sceneries[self.floor])
            return cameras[self.floor]

        return current_camera

    @cached_property
    def ceiling(self) -> Callable[[], CeilingCamera]:
        """A function that returns the camera that looks up on the robots' current floor."""
        from colony.sim.cameras.ceiling import CeilingCamera

        return self.camera_per_floor(lambda _, scenery: CeilingCamera(scenery))
