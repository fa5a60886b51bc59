"""The beam model of the position filter: the predicted readings of a ring of sonars at a pose on the map.

A wall reflects ultrasound like a mirror. A sonar detects the part of a wall that its cone hits within the
critical angle to the wall's normal, and reads the nearest point of that part: the perpendicular distance if
the normal lies in the cone (a region of constant depth), else the distance along the edge of the cone.
Corners are not modeled: a sonar that detects one mostly detects its walls as well. Source: Leonard and
Durrant-Whyte, Directed Sonar Sensing for Mobile Robot Navigation (1992).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.body.model import Body
from colony.body.shipped import ROME, shipped_body
from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.walls import Walls

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class SonarModel:
    """The model of a robot's sonars; lengths in mm, angles in degrees.

    What is known of the robot is in its body; what has a default is how the filter reads it.

    Attributes:
        count: number of sonars, in a ring that closes, counterclockwise.
        ahead: the sonar that looks straight ahead.
        ring_mm: distance from the robot's center to each transducer, where ranges begin.
        half_beam_deg: half the opening angle of the cone.
        critical_deg: maximum angle to a wall's normal at which the wall returns an echo.
        full_range_mm: reading of a sonar without an echo.
        reach_mm: maximum reading that is used.
        noise_mm, noise_fraction: standard deviation of a reading of a wall whose normal is in the cone: a
            constant, plus a fraction of the range. It is several times that of a single echo, since the
            errors of successive echoes of a wall are correlated.
        oblique_mm: the constant for a wall detected by the edge of the cone, which is blurred in reality.
    """

    count: int
    ahead: int
    ring_mm: float
    half_beam_deg: float
    critical_deg: float
    full_range_mm: float
    reach_mm: float = 6_000.0
    noise_mm: float = 12.0
    noise_fraction: float = 0.006
    oblique_mm: float = 30.0

    def bearings_rad(self) -> Floats:
        """Return the direction of each sonar, (count,), counterclockwise from ahead."""
        return np.arange(-self.ahead, self.count - self.ahead, dtype=np.float64) * (
            2.0 * math.pi / self.count
        )


def sonar_model_of(body: Body) -> SonarModel:
    """Return the model of a robot with this body.

    Raises:
        ValueError: it has no ring of sonars, more than one, or one in which nothing looks straight ahead.
    """
    ring = body.ring()
    return SonarModel(
        count=ring.count,
        ahead=ring.ahead,
        ring_mm=ring.ring_mm,
        half_beam_deg=ring.sonar.half_beam_deg,
        critical_deg=ring.sonar.critical_deg,
        full_range_mm=ring.sonar.range_mm,
    )


@cache
def rome_sonars() -> SonarModel:
    """Return the model of RoME's sonars."""
    return sonar_model_of(shipped_body(ROME))


class Reflectors(NamedTuple):
    """The walls of a map as reflectors of ultrasound.

    Attributes:
        start: (n, 2), one end of each wall in mm; looking along the wall from there, the free space is to the
            right.
        along, normal: (n, 2), unit vectors toward the other end, and into the free space.
        length: (n,) in mm.
        sigma_factor: (n,), factor for a reading's standard deviation: 1 for a wall, more for a door, which
            may be open, infinity for glass, which may return no echo.
    """

    start: Floats
    along: Floats
    normal: Floats
    length: Floats
    sigma_factor: Floats

    def within(self, x_mm: float, y_mm: float, reach_mm: float) -> Reflectors:
        """Return the walls that come within `reach_mm` of a point."""
        to_start = self.start - (x_mm, y_mm)
        nearest_along = np.clip(-(to_start * self.along).sum(axis=1), 0.0, self.length)
        nearest = to_start + nearest_along[:, None] * self.along
        chosen = (nearest * nearest).sum(axis=1) < reach_mm * reach_mm
        return Reflectors(*(field[chosen] for field in self))


_DOOR_SIGMA_FACTOR = 2.0


def reflectors_of(walls: Walls) -> Reflectors:
    """Return the reflectors of a map; doors may be open, and glass may return no echo."""
    kept = np.flatnonzero(np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T) > 1.0)
    segments = walls.segments[kept]
    extent = segments[:, 2:] - segments[:, :2]
    length = np.hypot(extent[:, 0], extent[:, 1])
    along = extent / length[:, None]
    sigma_factor = np.array([_DOOR_SIGMA_FACTOR if walls.kinds[i] is EdgeKind.DOOR else 1.0 for i in kept])
    sigma_factor[np.array(walls.glass, dtype=np.bool_)[kept]] = np.inf
    return Reflectors(
        start=segments[:, :2].copy(),
        along=along,
        normal=np.stack([along[:, 1], -along[:, 0]], axis=1),
        length=length,
        sigma_factor=sigma_factor,
    )


class Prediction(NamedTuple):
    """The predicted readings of the ring at a pose.

    Attributes:
        ranges: (sonars,) in mm; infinity where no echo is expected.
        sigma: (sonars,), standard deviation of each in mm; infinity where the prediction is not to be used.
        jacobian: (sonars, 3), derivatives of each by x and y (mm per mm) and by the heading (mm per radian).
    """

    ranges: Floats
    sigma: Floats
    jacobian: Floats


_RAYS = 5
_MIN_COSINE = 1e-6
_LEAK_MM = 0.5
# An echo from this many times the distance of the infinitely extended wall comes from the wall's end. The end
# is somewhere between two rays, and scan after scan between the same two: an error of up to 3 %, which
# averaging does not remove.
_END_RATIO = 1.003
_RAY = np.arange(_RAYS)[None, :]


class _Hit(NamedTuple):
    """The first hit of each sonar, (sonars,) each.

    Attributes:
        distance: distance to the hit; infinity without one.
        wall: index of the wall that is hit.
        height: perpendicular distance to that wall.
        detected: True for sonars that receive an echo.
    """

    distance: Floats
    wall: NDArray[np.intp]
    height: Floats
    detected: Bools


class SonarRing:
    """A ring of sonars with its beam model. Immutable."""

    def __init__(self, model: SonarModel) -> None:
        """Precompute the rays: five per cone, two of them on its edges."""
        self.model = model
        self._half_beam = math.radians(model.half_beam_deg)
        offsets = np.linspace(-1.0, 1.0, _RAYS) * self._half_beam
        self._bearings = model.bearings_rad()
        self._channel = np.arange(model.count)
        angles = (self._bearings[:, None] + offsets[None, :]).ravel()
        self._ray_u, self._ray_v = np.cos(angles), np.sin(angles)
        self._cos_critical = math.cos(math.radians(model.critical_deg))

    def predict(self, reflectors: Reflectors, x_mm: float, y_mm: float, heading_rad: float) -> Prediction:
        """Predict the readings at a pose; the heading counts counterclockwise from north."""
        if len(reflectors.length) == 0:
            no_echo = np.full(self.model.count, np.inf)
            return Prediction(no_echo, no_echo, np.zeros((self.model.count, 3)))
        sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
        ray_x = -self._ray_u * sine - self._ray_v * cosine
        ray_y = self._ray_u * cosine - self._ray_v * sine
        axis_x, axis_y = ray_x[_RAYS // 2 :: _RAYS], ray_y[_RAYS // 2 :: _RAYS]
        origin_x = x_mm + self.model.ring_mm * axis_x
        origin_y = y_mm + self.model.ring_mm * axis_y
        hit = self._cast(reflectors, np.stack([ray_x, ray_y], axis=1), np.stack([origin_x, origin_y], axis=1))
        return self._prediction(reflectors, hit, axis_x, axis_y)

    def _cast(self, reflectors: Reflectors, rays: Floats, origins: Floats) -> _Hit:
        """Return the first hit of each sonar."""
        start = reflectors.start
        normal, along = reflectors.normal.T, reflectors.along.T
        height = origins @ normal - (start * reflectors.normal).sum(axis=1)
        foot = origins @ along - (start * reflectors.along).sum(axis=1)
        cosines = -(rays @ normal).reshape(self.model.count, _RAYS, -1)
        sines = (rays @ along).reshape(self.model.count, _RAYS, -1)
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = height[:, None, :] / cosines
        hit_along = foot[:, None, :] + distances * sines
        hits = (cosines > _MIN_COSINE) & (height[:, None, :] > 0.0)
        hits &= (hit_along > -_LEAK_MM) & (hit_along < reflectors.length + _LEAK_MM)
        distances = np.where(hits, distances, np.inf)
        walls = distances.argmin(axis=2)
        ray_index = (self._channel[:, None], _RAY, walls)
        depth, cosine = distances[ray_index], cosines[ray_index]
        detected = (depth < self.model.reach_mm) & (cosine >= self._cos_critical)
        distance = np.where(detected, depth, np.inf)
        best_ray = (self._channel, distance.argmin(axis=1))
        first = walls[best_ray]
        return _Hit(
            distance=distance[best_ray],
            wall=first,
            height=height[self._channel, first],
            detected=detected[best_ray],
        )

    def _prediction(self, reflectors: Reflectors, hit: _Hit, axis_x: Floats, axis_y: Floats) -> Prediction:
        """Return the prediction for these hits."""
        model = self.model
        normal_x, normal_y = reflectors.normal[hit.wall].T
        phi = np.arctan2(  # angle of the axis from the perpendicular to the wall, counterclockwise
            normal_y * axis_x - normal_x * axis_y, -normal_x * axis_x - normal_y * axis_y
        )
        psi = phi - np.clip(phi, -self._half_beam, self._half_beam)
        secant = np.where(hit.detected, 1.0 / np.cos(psi), 1.0)
        turning = model.ring_mm * np.sin(phi) * secant + hit.height * np.sin(psi) * secant * secant
        sigma = np.where(psi == 0.0, model.noise_mm, model.oblique_mm) + model.noise_fraction * hit.height
        whole = hit.detected & (hit.distance < _END_RATIO * hit.height * secant)
        return Prediction(
            ranges=hit.distance,
            sigma=np.where(whole, sigma * reflectors.sigma_factor[hit.wall], np.inf),
            jacobian=np.stack([normal_x * secant, normal_y * secant, turning], axis=1),
        )
