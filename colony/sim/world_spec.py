"""The specification of a robot's world, for commands and for the process of the simulator."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

ViewDirection = float | Literal["up"]
"""Direction of a camera: degrees counterclockwise from ahead, or "up" at the ceiling."""


class WorldSpec(msgspec.Struct, frozen=True, kw_only=True):
    """The specification of a world, simulated or real.

    Attributes:
        map_path: the map of the building; None for a robot whose surroundings are unknown.
        seed: the seed of all random numbers, such as the sensors' noise.
        start: the initial pose, x and y in mm and the heading in degrees; None for the map's.
        hazards: the seed of the building's hazards (docs/hazards.md); None for no hazards.
        movers: the number of people who walk around between free places, besides those of the hazards.
        cameras: the directions of cameras by server name.
        floors: the names of the maps of the floors that elevators connect, the robot's first; empty if the
            robot stays on the map.
    """

    map_path: str | None = None
    seed: int = 0
    start: tuple[float, float, float] | None = None
    hazards: int | None = None
    movers: int = 0
    cameras: dict[str, ViewDirection] = {}
    floors: tuple[str, ...] = ()

    @property
    def requires_simulation(self) -> bool:
        """True if something is set that only a simulated world has."""
        return self.changed(map_path=None, seed=0) != WorldSpec()

    def changed(self, **changes: Any) -> WorldSpec:
        """Return the same world with other values of fields."""
        return msgspec.structs.replace(self, **changes)
