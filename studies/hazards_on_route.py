"""A description of the hazards on a robot's route."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.walls import walls_of
from colony.nav.plan.plan import Plan
from colony.sim.hazards.scenery import Scenery
from colony.sim.world.site import SimulatedSite

_CORRIDOR_MM = 3000.0
"""Distance from the route in mm beyond which a door or a person is in another corridor."""


def hazards_on_route(site: SimulatedSite, plan: Plan, slips: int) -> str:
    """Describe the hazards along a plan: "lights out: 1, doors open: 3, slips: 1".

    Args:
        site: the building with its hazards.
        plan: the plan.
        slips: the number of wheel slips.
    """
    counts: Counter[str] = Counter()
    for name, floor in site.maps.items():
        legs = [(*s.start[:2], *s.end[:2]) for s in plan.segments if s.start.floor == s.end.floor == name]
        counts.update(
            _hazard_counts(site.sceneries[name], walls_of(floor).segments, np.array(legs).reshape(-1, 4))
        )
    counts["slips"] = slips
    return ", ".join(f"{name}: {count}" for name, count in counts.items() if count)


def _hazard_counts(scenery: Scenery, walls: NDArray[np.float64], legs: NDArray[np.float64]) -> dict[str, int]:
    """Count the hazards along the legs, (m, 4), of a floor with edges (n, 4), all in mm."""
    lights = [(light.x_mm, light.y_mm, light.brightness) for light in scenery.lights]
    is_near = _near([light[:2] for light in lights], legs, _CORRIDOR_MM / 3)
    levels = [light[2] for light, light_is_near in zip(lights, is_near, strict=True) if light_is_near]
    centers = (walls[:, :2] + walls[:, 2:]) / 2.0
    glass = _count(centers[list(scenery.glass)], legs, 2 * _CORRIDOR_MM)
    doors = _count(centers[[door.edge for door in scenery.doors]], legs, _CORRIDOR_MM)
    sun_bands = _count([(sun.x_mm, sun.y_mm) for sun in scenery.sun], legs, _CORRIDOR_MM)
    starts = [person.track.point_at(person.along_mm, person.offset_mm) for person in scenery.people]
    people = _count([(start.x, start.y) for start in starts], legs, _CORRIDOR_MM)
    joints = [((j.x0_mm + j.x1_mm) / 2, (j.y0_mm + j.y1_mm) / 2) for j in scenery.joints]
    return {
        "lights out": sum(level == 0.0 for level in levels),
        "lights dim": sum(0.0 < level < 1.0 for level in levels),
        "bands of sun": sun_bands,
        "glass unheard": glass,
        "doors open": doors,
        "people": people,
        "joints": _count(joints, legs, _CORRIDOR_MM),
    }


def _count(points: object, legs: NDArray[np.float64], beside_mm: float) -> int:
    return int(_near(points, legs, beside_mm).sum())


def _near(points: object, legs: NDArray[np.float64], beside_mm: float) -> NDArray[np.bool_]:
    """Return a mask of the points, (n, 2), within `beside_mm` of any of the legs, (m, 4)."""
    position = np.array(points, dtype=np.float64).reshape(-1, 1, 2)
    start, along = legs[:, :2], legs[:, 2:] - legs[:, :2]
    squares = np.maximum((along**2).sum(axis=1), 1.0)
    along_fraction = np.clip(((position - start) * along).sum(axis=2) / squares, 0.0, 1.0)
    offset = position - (start + along_fraction[..., None] * along)
    near: NDArray[np.bool_] = (np.hypot(offset[..., 0], offset[..., 1]) <= beside_mm).any(axis=1)
    return near
