"""The map of a run, for a page."""

from __future__ import annotations

import math

from colony.body.model import Body, Polygon, radius_mm
from colony.nav.maps.world_map import WorldMap
from colony.watch.scene import MapScene

# --- footprint -----------------------------------------------------------------------------------------
#
# The footprint of a robot, for a page.


def footprint_of(body: Body) -> tuple[tuple[float, float], ...]:
    """Return the corners of a robot, x ahead and y left, in mm."""
    footprint = body.chassis.footprint
    if isinstance(footprint, Polygon):
        return tuple((corner.x_mm, corner.y_mm) for corner in footprint.corners)
    return circle(radius_mm(body))


CORNERS = 24
"""Corners of a circle in a picture."""


def circle(radius: float) -> tuple[tuple[float, float], ...]:
    """Return the corners of a circle."""
    angles = [2.0 * math.pi * i / CORNERS for i in range(CORNERS)]
    return tuple((round(radius * math.cos(a), 1), round(radius * math.sin(a), 1)) for a in angles)


# --- map -----------------------------------------------------------------------------------------------


def map_scene(world: WorldMap) -> MapScene:
    """Return a map for a page, to the millimeter."""
    return MapScene(
        name=world.name,
        walls=tuple(tuple(round(float(x)) for x in wall) for wall in world.walls),
        holes=tuple(tuple((round(float(x)), round(float(y))) for x, y in hole) for hole in world.holes),
    )
