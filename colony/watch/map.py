"""The map of a run, for a page."""

from __future__ import annotations

from colony.nav.maps.world_map import WorldMap
from colony.watch.scene import MapScene


def map_scene(world: WorldMap) -> MapScene:
    """Return a map for a page, to the millimeter."""
    return MapScene(
        name=world.name,
        walls=tuple(tuple(round(float(x)) for x in wall) for wall in world.walls),
        holes=tuple(tuple((round(float(x)), round(float(y))) for x, y in hole) for hole in world.holes),
    )
