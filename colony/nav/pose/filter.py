"""The position filter: estimates the pose from odometry, sonar echoes of the map's walls, and landmarks.

It is an extended Kalman filter over x, y, the heading, and two errors of the odometry: drift, as wheels of
unequal size turn a robot that seems to drive straight, and scale. The weight of a reading falls with its
normalized innovation (Huber), and is zero beyond a gate, so that people, open doors and cross-talk do no
harm. If most sonars are off at once, a wheel has slipped, and the filter tries headings around the estimate.
A landmark with a large innovation also indicates a slip: it moves the position, and leaves the odometry
errors as they are. Source: Thrun, Burgard and Fox, Probabilistic Robotics (2005), chapters 3 and 7; Leonard
and Durrant-Whyte 1992.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.pose.echoes import Floats, Prediction, Reflectors, SonarRing
from colony.nav.pose.fixes import Row
from colony.nav.pose.steps import NO_MOTION, MotionSince, Step


class JumpLimit(NamedTuple):
    """Limits of the correction by one landmark: the shift of the position and the turn of the heading."""

    mm: float
    rad: float


NO_JUMP_LIMIT = JumpLimit(math.inf, math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Standard deviations of the filter.

    Attributes:
        start_mm, start_deg, start_deg_m: initial values for the position, the heading and the drift per
            meter.
        scale: initial value for the odometry's scale: 0.01 is 10 mm per meter.
        way: noise of the distance of a step, as a part of it.
        way_mm: noise of the position after one meter; sqrt(d) times as much after d meters.
        drift_deg: noise of the heading, likewise.
        turn: noise of the heading, as a part of the turn of a step.
        drift_change_deg_m: noise of the drift per meter, likewise.
        most_mm: upper bound of the position's standard deviation.
    """

    start_mm: float = 60.0
    start_deg: float = 2.0
    start_deg_m: float = 1.5
    scale: float = 0.012
    way: float = 0.01
    travel_mm: float = 8.0
    drift_deg: float = 0.9
    turn: float = 0.02
    drift_change_deg_m: float = 0.1
    max_mm: float = 250.0


# In standard deviations of the innovation: the bounds from which a reading counts less, does not count, and
# still is as predicted; and the bound from which a landmark indicates a slip.
_HUBER = 1.5
_GATE = 3.5
_AS_PREDICTED = 1.5
_SLIP_GATE = 2.5
# Readings that change by this much per radian reveal a slip; those of walls that a sonar faces squarely do
# not.
_TURNING_MM = 200.0
_FEWEST_TURNING = 4

_STILL = 1e-6
_FEWEST = 3  # readings; fewer are mostly of a stretch of wall between two openings
_AGREEMENT_RATE = 0.3  # per scan: a few scans, so that passing people do not make the filter lost
_LOST = 0.65  # open doors and people spoil up to a third of the readings

# Relocation tries headings up to 35 degrees away, and fits the pose to the scan from each of them.
_TRIED_STEP_RAD = math.radians(5.0)
_TRIED_RAD = tuple(sign * n * _TRIED_STEP_RAD for n in range(8) for sign in ((1, -1) if n else (1,)))
_TRIED_MM = 60.0
_FARTHEST = 2.5
_ASIDE = 0.2  # lateral error per mm traveled of a robot whose wheels slipped
_CONFIRMED = 0.8
_FITS = 2
_FEWEST_TO_RELOCATE = 7
_EXPLAINED = 0.5
_BETTER = 0.02  # of two headings that explain a scan equally well the nearer one is taken
_EXPLAINED_SIGMA = 2.5
_WORTH_IT = 0.15  # more than a person before the robot explains
_MUCH_BETTER = 0.2
_AFTER_MM = 50.0
_AFTER_RAD = math.radians(3.0)


class PoseFilter:
    """The pose of a robot and its covariance. Mutable.

    The state is x, y in mm, the heading in radians counterclockwise from north, the drift in radians a mm,
    and the scale error of the odometry (0.01 if it reports 990 mm for a meter).
    """

    def __init__(
        self, ring: SonarRing, pose: tuple[float, float, float], noise: Uncertainty | None = None
    ) -> None:
        """Start at a pose: x, y in mm and the heading in degrees."""
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
        """Restart at a pose with this uncertainty; keep the estimated errors of the odometry."""
        place = self._noise.start_mm if sigma_mm is None else sigma_mm
        heading = math.radians(self._noise.start_deg if sigma_deg is None else sigma_deg)
        self.state[:3] = pose[0], pose[1], math.radians(pose[2])
        self.covariance = np.diag([place**2, place**2, heading**2, *self._odometry_variances])
        self.agreement = 1.0
        self._unconfirmed_mm = 0.0

    @property
    def _odometry_variances(self) -> list[float]:
        """The variances of drift and scale."""
        return [float(variance) for variance in np.diag(self.covariance)[3:]]

    def move(self, step: Step) -> Step:
        """Predict the pose after a step of the odometry; return the step without drift and scale error."""
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
        self._add_noise(way, turned)
        self._keep_bounded()
        return Step(ahead, left, turned + drift)

    def _add_noise(self, way: float, turned: float) -> None:
        """Add the process noise of a step: `way` in mm, `turned` in radians."""
        noise, meters = self._noise, way / 1e3
        spread = noise.travel_mm**2 * meters + (noise.way * way) ** 2
        self.covariance[0, 0] += spread
        self.covariance[1, 1] += spread
        self.covariance[2, 2] += math.radians(noise.drift_deg) ** 2 * meters + (noise.turn * turned) ** 2
        self.covariance[3, 3] += (math.radians(noise.drift_change_deg_m) / 1e3) ** 2 * meters

    def shift(self, x_mm: float, y_mm: float, turn_rad: float) -> None:
        """Follow a correction of the odometry by another client: the pose changes without a motion."""
        self.state[0] += x_mm
        self.state[1] += y_mm
        self.state[2] += turn_rad

    def _keep_bounded(self) -> None:
        """Bound the position's standard deviation along each axis."""
        for i in (0, 1):
            if self.covariance[i, i] > self._noise.max_mm**2:
                part = self._noise.max_mm / math.sqrt(self.covariance[i, i])
                self.covariance[i, :] *= part
                self.covariance[:, i] *= part

    @property
    def is_lost(self) -> bool:
        """True if most of the recent readings did not match the map."""
        return self.agreement < _LOST

    def observe_scan(self, reflectors: Reflectors, ranges: Floats, blur_rad: float = 0.0) -> None:
        """Update with a scan, (24,) in mm; readings that are not finite are ignored.

        `blur_rad` is the standard deviation of a heading error of this scan alone.
        """
        expected = self._ring.predict(reflectors, *self.state[:3])
        used = _usable(expected, ranges)
        if len(used) >= _FEWEST:
            kept = self._update(expected, ranges, used, blur_rad)
            self.agreement += _AGREEMENT_RATE * (kept - self.agreement)
            if len(used) >= _FEWEST_TO_RELOCATE and kept >= _CONFIRMED:
                self._unconfirmed_mm = 0.0

    def observe(self, row: Row, since: MotionSince = NO_MOTION, limit: JumpLimit = NO_JUMP_LIMIT) -> bool:
        """Update with a landmark's measurement of the pose at a past time.

        A large innovation indicates a slip, which is accepted up to `limit`.

        Returns:
            False if the measurement is rejected; the state is unchanged then.
        """
        way = math.hypot(row.cx, row.cy)
        if not row.sigma > 0.0 or not _is_unambiguous(row, way, limit):
            return False
        sine, cosine = math.sin(self.state[2]), math.cos(self.state[2])
        x = -since.ahead_mm * sine - since.left_mm * cosine
        y = since.ahead_mm * cosine - since.left_mm * sine
        then = self.state[:3] - (x, y, since.turned_rad)
        innovation = row.value - (row.cx * then[0] + row.cy * then[1] + row.ch * then[2])
        if row.ch:
            innovation = math.remainder(innovation, 2.0 * math.pi * abs(row.ch))  # modulo a full turn
        turning = row.ch + row.cx * y - row.cy * x
        jacobian = np.array([row.cx, row.cy, turning, 0.0, 0.0])
        meanwhile = self._noise.travel_mm**2 * since.travel_mm / 1e3 * way * way
        noise = row.sigma**2 + meanwhile
        variance = float(jacobian @ self.covariance @ jacobian) + noise
        normalized = abs(innovation) / math.sqrt(variance)
        slipped = normalized > _SLIP_GATE
        if slipped and abs(innovation) > (limit.mm * way if way else limit.rad * abs(row.ch)):
            return False
        if slipped:
            self._add_slip(row, innovation * innovation - variance + noise)
        gained = self.covariance @ jacobian
        gain = gained / (float(jacobian @ gained) + noise)
        if slipped:
            gain[3:] = 0.0
        self.state += gain * innovation
        kept = np.eye(len(gain)) - np.outer(gain, jacobian)
        self.covariance = kept @ self.covariance @ kept.T + noise * np.outer(gain, gain)
        return True

    def _add_slip(self, row: Row, variance: float) -> None:
        """Add the variance of an undetected slip to the position along a row, or to the heading."""
        axis = np.array([row.cx, row.cy, 0.0] if row.cx or row.cy else [0.0, 0.0, row.ch])
        axis /= float(axis @ axis)
        self.covariance[:3, :3] += max(variance, 0.0) * np.outer(axis, axis)

    def relocate(self, reflectors: Reflectors, ranges: Floats) -> bool:
        """Try headings around the estimate on one scan, and adopt the best; False if none explains the scan.

        The position must be about right, within what a slip since the last confirmed scan allows: a slipping
        wheel turns a robot more than it moves it.
        """
        saved, known = (self.state.copy(), self.covariance.copy()), self._odometry_variances
        best, found = max(_EXPLAINED, self._fit(reflectors, ranges) + _WORTH_IT), None
        for turn in _TRIED_RAD:
            self.state = saved[0].copy()
            self.state[2] += turn
            explained = self._explained(reflectors, ranges, known)
            x, y = self.state[:2] - saved[0][:2]
            if explained > best and math.hypot(x, y) < _FARTHEST * self._lost_sigma_mm:
                best, found = explained + _BETTER, self.state
        self.state, self.covariance = saved
        if found is None:
            return False
        self.agreement = max(self.agreement, _LOST)
        off = found - self.state
        if abs(off[2]) < _AFTER_RAD and math.hypot(off[0], off[1]) < _AFTER_MM:
            return False  # no other pose explains the scan better
        self.state[:3] = found[:3]
        self._inflate(_AFTER_MM, _AFTER_RAD)
        return True

    def adopt_if_better(
        self, pose: tuple[float, float, float], reflectors: Reflectors, ranges: Floats
    ) -> bool:
        """Adopt another pose if it explains a scan much better; return False otherwise.

        The pose is x and y in mm and the heading in degrees.
        """
        saved, known = (self.state.copy(), self.covariance.copy()), self._odometry_variances
        now = self._explained(reflectors, ranges, known)
        self.state = np.array([pose[0], pose[1], math.radians(pose[2]), *saved[0][3:]])
        then = self._explained(reflectors, ranges, known)
        found, (self.state, self.covariance) = self.state, saved
        if then < max(now + _MUCH_BETTER, _EXPLAINED):
            return False
        self.state[:3] = found[:3]
        self._inflate(_AFTER_MM, _AFTER_RAD)
        self.agreement = _LOST
        return True

    def _inflate(self, sigma_mm: float, sigma_rad: float) -> None:
        """Raise the pose's standard deviations to at least these; keep those of the odometry errors."""
        kept = np.diag(self.covariance)
        floor = (sigma_mm**2, sigma_mm**2, sigma_rad**2, 0.0, 0.0)
        self.covariance = np.diag(np.maximum(kept, floor))

    @property
    def _lost_sigma_mm(self) -> float:
        """Standard deviation of a lost robot's position, in mm."""
        return min(_TRIED_MM + _ASIDE * self._unconfirmed_mm, self._noise.max_mm)

    def _explained(self, reflectors: Reflectors, ranges: Floats, known: list[float]) -> float:
        """Fit the state to a scan, and return the part of the scan that it explains, from 0 to 1."""
        self.covariance = np.diag(
            [self._lost_sigma_mm**2, self._lost_sigma_mm**2, _TRIED_STEP_RAD**2, *known]
        )
        for _ in range(_FITS):
            expected = self._ring.predict(reflectors, *self.state[:3])
            used = _usable(expected, ranges)
            if len(used) < _FEWEST_TO_RELOCATE:
                return 0.0
            self._update(expected, ranges, used, 0.0)
        return self._fit(reflectors, ranges)

    def _fit(self, reflectors: Reflectors, ranges: Floats) -> float:
        """Return the part of a scan that the present state explains, from 0 to 1."""
        expected = self._ring.predict(reflectors, *self.state[:3])
        used = _usable(expected, ranges)
        if len(used) < _FEWEST_TO_RELOCATE:
            return 0.0
        off = (ranges[used] - expected.ranges[used]) / (_EXPLAINED_SIGMA * expected.sigma[used])
        return float(np.maximum(1.0 - off * off, 0.0).mean())

    def _update(self, expected: Prediction, ranges: Floats, used: NDArray[np.intp], blur_rad: float) -> float:
        """Update the state with one scan; return the part of the readings that were as predicted."""
        jacobian = np.zeros((len(used), len(self.state)))
        jacobian[:, :3] = expected.jacobian[used]
        innovation = ranges[used] - expected.ranges[used]
        noise = expected.sigma[used] ** 2 + (jacobian[:, 2] * blur_rad) ** 2
        variance = noise + np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        size = np.abs(innovation) / np.sqrt(variance)
        kept = size < _GATE
        if kept.any():
            weight = np.minimum(1.0, _HUBER / np.maximum(size[kept], _STILL)) / noise[kept]
            rows = jacobian[kept]
            # The information form needs 5 x 5 inverses only, however many the readings.
            scale = np.sqrt(np.diag(self.covariance))
            prior = np.linalg.inv(self.covariance / np.outer(scale, scale))
            rows = rows * scale
            posterior = np.linalg.inv(prior + rows.T @ (weight[:, None] * rows))
            self.state += scale * (posterior @ (rows.T @ (weight * innovation[kept])))
            self.covariance = posterior * np.outer(scale, scale)
        as_predicted = size < _AS_PREDICTED
        turning = as_predicted[np.abs(jacobian[:, 2]) > _TURNING_MM]
        part = float(as_predicted.mean())
        return part if len(turning) < _FEWEST_TURNING else min(part, float(turning.mean()))


def _is_unambiguous(row: Row, way: float, limit: JumpLimit) -> bool:
    """Return True if a row is not empty, and a full turn of its heading cannot pass for another position."""
    if row.ch == 0.0 or way == 0.0 or limit.mm == math.inf:
        return row.ch != 0.0 or way != 0.0
    return math.pi * abs(row.ch) > limit.mm * way


def _usable(expected: Prediction, ranges: Floats) -> NDArray[np.intp]:
    """Return the sonars with both a prediction and a reading."""
    return np.flatnonzero(np.isfinite(expected.sigma) & np.isfinite(ranges))
