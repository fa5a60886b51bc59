"""The position filter: the pose from odometry, sonar echoes of the map's walls, and landmarks.

An extended Kalman filter over x, y, the heading, and the errors of the odometry: its curvature, since wheels
of unequal size turn a robot that believes that it goes straight, and its scale. The weight of a reading falls
with its surprise (Huber), and is zero beyond a gate, so that people, open doors and cross-talk do no harm. A
surprise for most of the sonars at once means that a wheel slipped: then headings all around are tried. A
surprising landmark also indicates a slip: it moves the position, and teaches nothing of the odometry. Source:
Thrun, Burgard and Fox, Probabilistic Robotics (2005), chapters 3 and 7; Leonard and Durrant-Whyte 1992.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.pose.echoes import Expected, Floats, Mirrors, Ring
from colony.nav.pose.fixes import Row
from colony.nav.pose.steps import NOW, Since, Step


class Leap(NamedTuple):
    """Limits of how far a landmark may move the position at once, and turn the heading."""

    mm: float
    rad: float


ANY_LEAP = Leap(math.inf, math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Standard deviations of the filter.

    Attributes:
        start_mm, start_deg, start_deg_m: at first, of the position, the heading and the drift a meter.
        scale: of the odometry's scale at first: 0.01 is 10 mm a meter.
        way: of the distance, a part of it, on each step.
        way_mm: of the position, on the first meter; sqrt(d) times as much on d meters.
        drift_deg: of the heading, likewise.
        turn: of the heading, a part of what is turned in a step.
        drift_change_deg_m: of the drift a meter, on the first meter, likewise.
        most_mm: no position is less certain than this.
    """

    start_mm: float = 60.0
    start_deg: float = 2.0
    start_deg_m: float = 1.5
    scale: float = 0.012
    way: float = 0.01
    way_mm: float = 8.0
    drift_deg: float = 0.9
    turn: float = 0.02
    drift_change_deg_m: float = 0.1
    most_mm: float = 250.0


# In standard deviations: from where a reading counts less, where not at all, up to where it is as expected;
# and from where a landmark indicates a slip.
_HUBER = 1.5
_GATE = 3.5
_AS_EXPECTED = 1.5
_SLIPPED = 2.5
# Readings that change by so much a radian reveal a slip; those of walls straight ahead of a sonar do not.
_TURNING_MM = 200.0
_FEWEST_TURNING = 4

_STILL = 1e-6
_FEWEST = 3  # informative readings; fewer are mostly a stretch of wall between two openings
_AGREEMENT_RATE = 0.3  # a few scans, so that passing people do not count as being lost
_LOST = 0.65  # open doors and people spoil up to a third of the readings

# Relocation: headings up to 35 degrees away, each fitted to the scan from half-way to the next one.
_TRIED_STEP_RAD = math.radians(5.0)
_TRIED_RAD = tuple(sign * n * _TRIED_STEP_RAD for n in range(8) for sign in ((1, -1) if n else (1,)))
_TRIED_MM = 60.0
_FARTHEST = 2.5
_ASIDE = 0.2  # so far off its way, a mm, goes a robot whose wheels slipped
_CONFIRMED = 0.8
_FITS = 2
_FEWEST_TO_RELOCATE = 7
_EXPLAINED = 0.5
_BETTER = 0.02  # of two headings that explain a scan alike the nearer one is taken
_EXPLAINED_SIGMA = 2.5
_WORTH_IT = 0.15  # more than one person explains
_MUCH_BETTER = 0.2
_AFTER_MM = 50.0
_AFTER_RAD = math.radians(3.0)


class PoseFilter:
    """The pose of a robot and its covariance. Mutable.

    The state is x, y in mm, the heading in radians counterclockwise from north, the drift in radians a mm,
    and the scale error of the odometry (0.01 where it says 990 mm for a meter).
    """

    def __init__(
        self, ring: Ring, pose: tuple[float, float, float], noise: Uncertainty | None = None
    ) -> None:
        """Begin at a pose: x, y in mm and the heading in degrees."""
        self._ring = ring
        self._noise = noise or Uncertainty()
        self.state = np.array([pose[0], pose[1], math.radians(pose[2]), 0.0, 0.0])
        drift_rad_mm = math.radians(self._noise.start_deg_m) / 1e3
        self.covariance = np.diag([0.0, 0.0, 0.0, drift_rad_mm**2, self._noise.scale**2])
        self.agreement = 1.0
        self._unconfirmed_mm = 0.0
        self.reset(pose)

    def reset(
        self, pose: tuple[float, float, float], sigma_mm: float | None = None, sigma_deg: float | None = None
    ) -> None:
        """Restart at a pose with this uncertainty; the errors of the odometry stay."""
        place = self._noise.start_mm if sigma_mm is None else sigma_mm
        heading = math.radians(self._noise.start_deg if sigma_deg is None else sigma_deg)
        self.state[:3] = pose[0], pose[1], math.radians(pose[2])
        self.covariance = np.diag([place**2, place**2, heading**2, *self._of_odometry])
        self.agreement = 1.0
        self._unconfirmed_mm = 0.0

    @property
    def _of_odometry(self) -> list[float]:
        """The variances of drift and scale."""
        return [float(variance) for variance in np.diag(self.covariance)[3:]]

    def move(self, step: Step) -> Step:
        """Take in how the odometry says that the robot moved; gives that without drift and scale error."""
        way = math.hypot(step.ahead_mm, step.left_mm)
        if way < _STILL and abs(step.turned_rad) < _STILL:
            return step
        self._unconfirmed_mm += way
        longer = 1.0 + self.state[4]
        ahead, left, turned = longer * step.ahead_mm, longer * step.left_mm, step.turned_rad
        signed = math.copysign(way, ahead)
        drift = self.state[3] * signed
        middle = self.state[2] + drift / 2.0
        sine, cosine = math.sin(middle), math.cos(middle)
        x, y = -ahead * sine - left * cosine, ahead * cosine - left * sine
        self.state[0] += x
        self.state[1] += y
        self.state[2] += turned + drift
        change = np.eye(5)
        change[0, 2], change[1, 2] = -y, x
        change[0, 3], change[1, 3], change[2, 3] = -y * signed / 2.0, x * signed / 2.0, signed
        change[0, 4], change[1, 4] = x / longer, y / longer
        self.covariance = change @ self.covariance @ change.T
        self._spread(way, turned)
        self._keep_bounded()
        return Step(ahead, left, turned + drift)

    def _spread(self, way: float, turned: float) -> None:
        """Add the uncertainty of a step of so many mm and radians."""
        noise, meters = self._noise, way / 1e3
        spread = noise.way_mm**2 * meters + (noise.way * way) ** 2
        self.covariance[0, 0] += spread
        self.covariance[1, 1] += spread
        self.covariance[2, 2] += math.radians(noise.drift_deg) ** 2 * meters + (noise.turn * turned) ** 2
        self.covariance[3, 3] += (math.radians(noise.drift_change_deg_m) / 1e3) ** 2 * meters

    def shift(self, x_mm: float, y_mm: float, turn_rad: float) -> None:
        """Apply a correction of the odometry: the robot did not move, but its pose is another one."""
        self.state[0] += x_mm
        self.state[1] += y_mm
        self.state[2] += turn_rad

    def _keep_bounded(self) -> None:
        """Shrink the covariance along an axis that became less certain than it can be."""
        for i in (0, 1):
            if self.covariance[i, i] > self._noise.most_mm**2:
                part = self._noise.most_mm / math.sqrt(self.covariance[i, i])
                self.covariance[i, :] *= part
                self.covariance[:, i] *= part

    @property
    def is_lost(self) -> bool:
        """True if most of the recent readings did not match the map."""
        return self.agreement < _LOST

    def listen(self, mirrors: Mirrors, ranges: Floats, blur_rad: float = 0.0) -> None:
        """Take in a scan: (24,) in mm; what is not finite says nothing.

        `blur_rad`: by how much the heading may be off for this scan alone.
        """
        expected = self._ring.expect(mirrors, *self.state[:3])
        used = _told(expected, ranges)
        if len(used) >= _FEWEST:
            kept = self._update(expected, ranges, used, blur_rad)
            self.agreement += _AGREEMENT_RATE * (kept - self.agreement)
            if len(used) >= _FEWEST_TO_RELOCATE and kept >= _CONFIRMED:
                self._unconfirmed_mm = 0.0

    def observe(self, row: Row, since: Since = NOW, most: Leap = ANY_LEAP) -> bool:
        """Take in a landmark's observation of the pose a while ago.

        A surprise indicates a slip, which is believed up to `most`.

        Returns:
            False if the observation is not believed; then nothing has changed.
        """
        way = math.hypot(row.cx, row.cy)
        if not row.sigma > 0.0 or not _is_plain(row, way, most):
            return False
        sine, cosine = math.sin(self.state[2]), math.cos(self.state[2])
        x = -since.ahead_mm * sine - since.left_mm * cosine
        y = since.ahead_mm * cosine - since.left_mm * sine
        then = self.state[:3] - (x, y, since.turned_rad)
        off = row.value - (row.cx * then[0] + row.cy * then[1] + row.ch * then[2])
        if row.ch:
            off = math.remainder(off, 2.0 * math.pi * abs(row.ch))  # headings of any turn are meant
        turning = row.ch + row.cx * y - row.cy * x
        jacobian = np.array([row.cx, row.cy, turning, 0.0, 0.0])
        meanwhile = self._noise.way_mm**2 * since.way_mm / 1e3 * way * way
        own = row.sigma**2 + meanwhile
        spread = float(jacobian @ self.covariance @ jacobian) + own
        surprise = abs(off) / math.sqrt(spread)
        slipped = surprise > _SLIPPED
        if slipped and abs(off) > (most.mm * way if way else most.rad * abs(row.ch)):
            return False
        if slipped:
            self._loosen(row, off * off - spread + own)
        gained = self.covariance @ jacobian
        gain = gained / (float(jacobian @ gained) + own)
        if slipped:
            gain[3:] = 0.0
        self.state += gain * off
        kept = np.eye(len(gain)) - np.outer(gain, jacobian)
        self.covariance = kept @ self.covariance @ kept.T + own * np.outer(gain, gain)
        return True

    def _loosen(self, row: Row, variance: float) -> None:
        """Add the variance of an unnoticed change to the position along a row, or to the heading."""
        axis = np.array([row.cx, row.cy, 0.0] if row.cx or row.cy else [0.0, 0.0, row.ch])
        axis /= float(axis @ axis)
        self.covariance[:3, :3] += max(variance, 0.0) * np.outer(axis, axis)

    def relocate(self, mirrors: Mirrors, ranges: Floats) -> bool:
        """Try headings all around by one scan, and take one that explains most of it; False if none does.

        The position must be about right, as far as it can be since walls were last where they belong: a wheel
        that slips turns a robot more than it moves it.
        """
        saved, known = (self.state.copy(), self.covariance.copy()), self._of_odometry
        best, found = max(_EXPLAINED, self._fit(mirrors, ranges) + _WORTH_IT), None
        for turn in _TRIED_RAD:
            self.state = saved[0].copy()
            self.state[2] += turn
            explained = self._explained(mirrors, ranges, known)
            x, y = self.state[:2] - saved[0][:2]
            if explained > best and math.hypot(x, y) < _FARTHEST * self._aside_mm:
                best, found = explained + _BETTER, self.state
        self.state, self.covariance = saved
        if found is None:
            return False
        self.agreement = max(self.agreement, _LOST)
        off = found - self.state
        if abs(off[2]) < _AFTER_RAD and math.hypot(off[0], off[1]) < _AFTER_MM:
            return False  # what is wrong is nothing that another pose mends
        self.state[:3] = found[:3]
        self._doubt(_AFTER_MM, _AFTER_RAD)
        return True

    def consider(self, pose: tuple[float, float, float], mirrors: Mirrors, ranges: Floats) -> bool:
        """Go on from another pose if it explains a scan better; return False if it does not.

        The pose is x and y in mm and the heading in degrees.
        """
        saved, known = (self.state.copy(), self.covariance.copy()), self._of_odometry
        now = self._explained(mirrors, ranges, known)
        self.state = np.array([pose[0], pose[1], math.radians(pose[2]), *saved[0][3:]])
        then = self._explained(mirrors, ranges, known)
        found, (self.state, self.covariance) = self.state, saved
        if then < max(now + _MUCH_BETTER, _EXPLAINED):
            return False
        self.state[:3] = found[:3]
        self._doubt(_AFTER_MM, _AFTER_RAD)
        self.agreement = _LOST
        return True

    def _doubt(self, sigma_mm: float, sigma_rad: float) -> None:
        """Make the pose this uncertain at least; what is known of the odometry stays."""
        kept = np.diag(self.covariance)
        floor = (sigma_mm**2, sigma_mm**2, sigma_rad**2, 0.0, 0.0)
        self.covariance = np.diag(np.maximum(kept, floor))

    @property
    def _aside_mm(self) -> float:
        """Standard deviation of the position where the way was lost, in mm."""
        return min(_TRIED_MM + _ASIDE * self._unconfirmed_mm, self._noise.most_mm)

    def _explained(self, mirrors: Mirrors, ranges: Floats, known: list[float]) -> float:
        """Return how much of a scan the state explains after a fit to it: from 0 to 1 for each reading."""
        self.covariance = np.diag([self._aside_mm**2, self._aside_mm**2, _TRIED_STEP_RAD**2, *known])
        for _ in range(_FITS):
            expected = self._ring.expect(mirrors, *self.state[:3])
            used = _told(expected, ranges)
            if len(used) < _FEWEST_TO_RELOCATE:
                return 0.0
            self._update(expected, ranges, used, 0.0)
        return self._fit(mirrors, ranges)

    def _fit(self, mirrors: Mirrors, ranges: Floats) -> float:
        """Return how much of a scan the state explains as it is."""
        expected = self._ring.expect(mirrors, *self.state[:3])
        used = _told(expected, ranges)
        if len(used) < _FEWEST_TO_RELOCATE:
            return 0.0
        off = (ranges[used] - expected.ranges[used]) / (_EXPLAINED_SIGMA * expected.sigma[used])
        return float(np.maximum(1.0 - off * off, 0.0).mean())

    def _update(self, expected: Expected, ranges: Floats, used: NDArray[np.intp], blur_rad: float) -> float:
        """Correct the state by one scan; gives which part of the walls was read as expected."""
        jacobian = np.zeros((len(used), len(self.state)))
        jacobian[:, :3] = expected.jacobian[used]
        surprise = ranges[used] - expected.ranges[used]
        own = expected.sigma[used] ** 2 + (jacobian[:, 2] * blur_rad) ** 2
        spread = own + np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        size = np.abs(surprise) / np.sqrt(spread)
        kept = size < _GATE
        if kept.any():
            weight = np.minimum(1.0, _HUBER / np.maximum(size[kept], _STILL)) / own[kept]
            rows = jacobian[kept]
            # In the form of information: five unknowns, however many readings.
            scale = np.sqrt(np.diag(self.covariance))
            prior = np.linalg.inv(self.covariance / np.outer(scale, scale))
            rows = rows * scale
            posterior = np.linalg.inv(prior + rows.T @ (weight[:, None] * rows))
            self.state += scale * (posterior @ (rows.T @ (weight * surprise[kept])))
            self.covariance = posterior * np.outer(scale, scale)
        as_expected = size < _AS_EXPECTED
        turning = as_expected[np.abs(jacobian[:, 2]) > _TURNING_MM]
        part = float(as_expected.mean())
        return part if len(turning) < _FEWEST_TURNING else min(part, float(turning.mean()))


def _is_plain(row: Row, way: float, most: Leap) -> bool:
    """Return True if a row says something that no turn of the heading can confuse with another place."""
    if row.ch == 0.0 or way == 0.0 or most.mm == math.inf:
        return row.ch != 0.0 or way != 0.0
    return math.pi * abs(row.ch) > most.mm * way


def _told(expected: Expected, ranges: Floats) -> NDArray[np.intp]:
    """Return the sonars that are expected to hear a wall, and have a reading."""
    return np.flatnonzero(np.isfinite(expected.sigma) & np.isfinite(ranges))
