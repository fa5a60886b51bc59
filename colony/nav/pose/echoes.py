"""The expected readings of a ring of sonars at a pose on the map: the beam model of the position filter.

A wall is a mirror for ultrasound. It is heard by the part of the cone that meets it within the critical angle
to its normal, and the nearest of that is what is read: the perpendicular distance where the normal lies in
the cone (a region of constant depth), else the distance along the edge of the cone. Corners are left out:
where one is heard, its walls mostly are as well. Source: Leonard and Durrant-Whyte, Directed Sonar Sensing
for Mobile Robot Navigation (1992).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.walls import Walls

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

CHANNELS = 24
"""Sonars, 15 degrees apart counterclockwise: 12 ahead, 18 left, 0 back, 6 right."""

BEARINGS_RAD = (np.arange(CHANNELS) - 12) * (2.0 * math.pi / CHANNELS)
"""(24,), where each sonar looks, counterclockwise from ahead."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SonarModel:
    """The model of a robot's sonars; lengths in mm, angles in degrees.

    Attributes:
        ring_mm: from the robot's center to each transducer; readings count from there.
        half_beam_deg: half the opening of the cone.
        critical_deg: a wall met at a larger angle to its normal is silent.
        full_range_mm: a reading this long says that nothing was heard.
        reach_mm: readings beyond this are not used.
        noise_mm, noise: the standard deviation of a reading of a wall whose normal is in the cone: so much,
            plus so much times the range. It is several times that of a single echo, for what is wrong with
            one echo of a wall is also wrong with the next.
        oblique_mm: the same for a wall heard with the edge of the cone, which no cone really has.
    """

    ring_mm: float = 360.0
    half_beam_deg: float = 12.0
    critical_deg: float = 30.0
    full_range_mm: float = 10_000.0
    reach_mm: float = 6_000.0
    noise_mm: float = 12.0
    noise: float = 0.006
    oblique_mm: float = 30.0


class Mirrors(NamedTuple):
    """The walls of a map as things that echo.

    Attributes:
        start: (n, 2), one end of each in mm; the free space is to the right as seen from there.
        along, normal: (n, 2), unit vectors: to the other end, and into the free space.
        length: (n,) in mm.
        doubt: (n,): 1 for a wall, more for what may look otherwise, infinity for what may not be heard.
    """

    start: Floats
    along: Floats
    normal: Floats
    length: Floats
    doubt: Floats

    def near(self, x_mm: float, y_mm: float, reach_mm: float) -> Mirrors:
        """Return the walls that come nearer to a point than `reach_mm`."""
        to_start = self.start - (x_mm, y_mm)
        part = np.clip(-(to_start * self.along).sum(axis=1), 0.0, self.length)
        nearest = to_start + part[:, None] * self.along
        chosen = (nearest * nearest).sum(axis=1) < reach_mm * reach_mm
        return Mirrors(*(field[chosen] for field in self))


_DOOR_DOUBT = 2.0


def mirrors_of(walls: Walls) -> Mirrors:
    """Return the walls that echo, and how far to trust each: doors may be open, glass may be silent."""
    kept = np.flatnonzero(np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T) > 1.0)
    segments = walls.segments[kept]
    extent = segments[:, 2:] - segments[:, :2]
    length = np.hypot(extent[:, 0], extent[:, 1])
    along = extent / length[:, None]
    doubt = np.array([_DOOR_DOUBT if walls.kinds[i] is EdgeKind.DOOR else 1.0 for i in kept])
    doubt[np.array(walls.glass, dtype=np.bool_)[kept]] = np.inf
    return Mirrors(
        start=segments[:, :2].copy(),
        along=along,
        normal=np.stack([along[:, 1], -along[:, 0]], axis=1),
        length=length,
        doubt=doubt,
    )


class Expected(NamedTuple):
    """The expected readings of the ring at a pose.

    Attributes:
        ranges: (24,) in mm; infinity where nothing is to be heard.
        sigma: (24,), the standard deviation of each in mm; infinity where it is not to be trusted.
        jacobian: (24, 3), by how much each grows with x, y (mm a mm) and the heading (mm a radian).
    """

    ranges: Floats
    sigma: Floats
    jacobian: Floats


_RAYS = 5
_LEAST_COSINE = 1e-6
_LEAK_MM = 0.5
# A wall that is heard from so many times as far away as if it went on is heard by its end. That is somewhere
# between two rays, the same two scan after scan: up to 3 % wrong, and no other scan makes up for it.
_END = 1.003
_CHANNEL = np.arange(CHANNELS)
_RAY = np.arange(_RAYS)[None, :]


class _Hit(NamedTuple):
    """The first hit of each sonar, (24,) each.

    The distance, infinity for nothing; the wall that is hit; the perpendicular distance to that wall; and
    whether the sonar hears anything.
    """

    echo: Floats
    wall: NDArray[np.intp]
    height: Floats
    heard: Bools


class Ring:
    """A ring of sonars that knows its beam model. Immutable."""

    def __init__(self, model: SonarModel) -> None:
        """Lay out the rays: five a cone, two of them on its edges."""
        self.model = model
        self._half_beam = math.radians(model.half_beam_deg)
        offsets = np.linspace(-1.0, 1.0, _RAYS) * self._half_beam
        angles = (BEARINGS_RAD[:, None] + offsets[None, :]).ravel()
        self._ray_u, self._ray_v = np.cos(angles), np.sin(angles)
        self._cos_critical = math.cos(math.radians(model.critical_deg))

    def expect(self, mirrors: Mirrors, x_mm: float, y_mm: float, heading_rad: float) -> Expected:
        """Return the expected readings at a pose; the heading counts counterclockwise from north."""
        if len(mirrors.length) == 0:
            silence = np.full(CHANNELS, np.inf)
            return Expected(silence, silence, np.zeros((CHANNELS, 3)))
        sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
        ray_x = -self._ray_u * sine - self._ray_v * cosine
        ray_y = self._ray_u * cosine - self._ray_v * sine
        axis_x, axis_y = ray_x[_RAYS // 2 :: _RAYS], ray_y[_RAYS // 2 :: _RAYS]
        from_x = x_mm + self.model.ring_mm * axis_x
        from_y = y_mm + self.model.ring_mm * axis_y
        hit = self._cast(mirrors, np.stack([ray_x, ray_y], axis=1), np.stack([from_x, from_y], axis=1))
        return self._of_walls(mirrors, hit, axis_x, axis_y)

    def _cast(self, mirrors: Mirrors, rays: Floats, origins: Floats) -> _Hit:
        """Return the first hit of each sonar."""
        start = mirrors.start
        normal, along = mirrors.normal.T, mirrors.along.T
        height = origins @ normal - (start * mirrors.normal).sum(axis=1)
        foot = origins @ along - (start * mirrors.along).sum(axis=1)
        closing = -(rays @ normal).reshape(CHANNELS, _RAYS, -1)
        passing = (rays @ along).reshape(CHANNELS, _RAYS, -1)
        with np.errstate(divide="ignore", invalid="ignore"):
            ways = height[:, None, :] / closing
        spots = foot[:, None, :] + ways * passing
        met = (closing > _LEAST_COSINE) & (height[:, None, :] > 0.0)
        met &= (spots > -_LEAK_MM) & (spots < mirrors.length + _LEAK_MM)
        ways = np.where(met, ways, np.inf)
        walls = ways.argmin(axis=2)
        at = (_CHANNEL[:, None], _RAY, walls)
        depth, cosine = ways[at], closing[at]
        heard = (depth < self.model.reach_mm) & (cosine >= self._cos_critical)
        echo = np.where(heard, depth, np.inf)
        pick = (_CHANNEL, echo.argmin(axis=1))
        first = walls[pick]
        return _Hit(echo=echo[pick], wall=first, height=height[_CHANNEL, first], heard=heard[pick])

    def _of_walls(self, mirrors: Mirrors, hit: _Hit, axis_x: Floats, axis_y: Floats) -> Expected:
        """Return the expected readings of walls, their dependence on the pose, and their uncertainty."""
        model = self.model
        normal_x, normal_y = mirrors.normal[hit.wall].T
        phi = np.arctan2(  # of the axis, counterclockwise from the way straight to the wall
            normal_y * axis_x - normal_x * axis_y, -normal_x * axis_x - normal_y * axis_y
        )
        psi = phi - np.clip(phi, -self._half_beam, self._half_beam)
        secant = np.where(hit.heard, 1.0 / np.cos(psi), 1.0)
        turning = model.ring_mm * np.sin(phi) * secant + hit.height * np.sin(psi) * secant * secant
        sigma = np.where(psi == 0.0, model.noise_mm, model.oblique_mm) + model.noise * hit.height
        whole = hit.heard & (hit.echo < _END * hit.height * secant)
        return Expected(
            ranges=hit.echo,
            sigma=np.where(whole, sigma * mirrors.doubt[hit.wall], np.inf),
            jacobian=np.stack([normal_x * secant, normal_y * secant, turning], axis=1),
        )
