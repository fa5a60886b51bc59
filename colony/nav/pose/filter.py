"""The position filter: estimates the pose from odometry, sonar echoes of the map's walls, and landmarks.

It is an extended Kalman filter over x, y, the heading, and two errors of the odometry: drift, as wheels of
unequal size turn a robot that seems to drive straight, and scale. The weight of a reading falls with its
normalized innovation (Huber), and is zero beyond a gate, so that people, open doors and cross-talk do no
harm. If most readings are wrong at once, a wheel has slipped, and the filter tries headings around the
estimate. A landmark with a large innovation also indicates a slip: it moves the position, and leaves the
odometry errors as they are. Source: Thrun, Burgard and Fox, Probabilistic Robotics (2005), chapters 3 and 7;
Leonard and Durrant-Whyte 1992.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.pose.echoes import Floats, Prediction, Reflectors, SonarRing
from colony.nav.pose.pose import NO_MOTION, MeasurementRow, MotionSince, OdometryStep


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
        scale: initial value for the odometry's scale error: 0.01 is 10 mm per meter.
        travel_fraction: noise of the position, as a fraction of the distance of a step.
        travel_mm: noise of the position after one meter; it grows with the square root of the distance.
        drift_deg: noise of the heading after one meter; it grows in the same way.
        turn_fraction: noise of the heading, as a fraction of the turn of a step.
        drift_change_deg_m: noise of the drift after one meter; it grows in the same way.
        max_mm: upper bound of the position's standard deviation.
    """

    start_mm: float = 60.0
    start_deg: float = 2.0
    start_deg_m: float = 1.5
    scale: float = 0.012
    travel_fraction: float = 0.01
    travel_mm: float = 8.0
    drift_deg: float = 0.9
    turn_fraction: float = 0.02
    drift_change_deg_m: float = 0.1
    max_mm: float = 250.0


# In standard deviations of the innovation: above _HUBER a reading has less weight, above _GATE none; up to
# _PREDICTED_GATE it is as predicted; above _SLIP_GATE a landmark indicates a slip.
_HUBER = 1.5
_GATE = 3.5
_PREDICTED_GATE = 1.5
_SLIP_GATE = 2.5
# Readings that change by at least this much per radian reveal a slip; those of walls that a sonar faces
# squarely do not.
_TURNING_MM = 200.0
_MIN_TURNING_READINGS = 4

_TINY = 1e-6
_MIN_READINGS = 3  # fewer readings mostly come from a short piece of wall between two openings
_AGREEMENT_RATE = 0.3  # per scan; low enough that the filter is not lost when people pass
_LOST_AGREEMENT = 0.65  # open doors and people spoil up to a third of the readings

# Relocation tries headings up to 35 degrees away, and fits the pose to the scan from each of them.
_TURN_STEP_RAD = math.radians(5.0)
_TRIED_TURNS_RAD = tuple(sign * n * _TURN_STEP_RAD for n in range(8) for sign in ((1, -1) if n else (1,)))
_MIN_LOST_SIGMA_MM = 60.0
_MAX_SHIFT_SIGMAS = 2.5
_SLIP_LATERAL_FRACTION = 0.2  # lateral error per mm traveled of a robot whose wheels slipped
_CONFIRMED_AGREEMENT = 0.8
_FIT_ITERATIONS = 2
_MIN_RELOCATION_READINGS = 7
_MIN_EXPLAINED = 0.5
_TIE_MARGIN = 0.02  # of two headings that explain a scan equally well, the nearer one is used
_EXPLAINED_SIGMA = 2.5
_MIN_GAIN = 0.15  # more than a person in front of the robot can cause
_MIN_ADOPTION_GAIN = 0.2
_RELOCATED_MM = 50.0
_RELOCATED_RAD = math.radians(3.0)


class PoseFilter:
    """The pose of a robot and its covariance. Mutable.

    The state is x, y in mm, the heading in radians counterclockwise from north, the drift in radians per mm,
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
        position_sigma = self._noise.start_mm if sigma_mm is None else sigma_mm
        heading_sigma = math.radians(self._noise.start_deg if sigma_deg is None else sigma_deg)
        self.state[:3] = pose[0], pose[1], math.radians(pose[2])
        self.covariance = np.diag(
            [position_sigma**2, position_sigma**2, heading_sigma**2, *self._odometry_variances]
        )
        self.agreement = 1.0
        self._unconfirmed_mm = 0.0

    @property
    def _odometry_variances(self) -> list[float]:
        """The variances of the drift and the scale error."""
        return [float(variance) for variance in np.diag(self.covariance)[3:]]

    def move(self, step: OdometryStep) -> OdometryStep:
        """Predict the pose after a step; return the step corrected for drift and scale error."""
        travel = math.hypot(step.ahead_mm, step.left_mm)
        if travel < _TINY and abs(step.turned_rad) < _TINY:
            return step
        self._unconfirmed_mm += travel
        scale = 1.0 + self.state[4]
        ahead, left, turned = scale * step.ahead_mm, scale * step.left_mm, step.turned_rad
        signed = math.copysign(travel, ahead)
        drift = self.state[3] * signed
        mid_heading = self.state[2] + drift / 2.0
        sine, cosine = math.sin(mid_heading), math.cos(mid_heading)
        x, y = -ahead * sine - left * cosine, ahead * cosine - left * sine
        self.state[0] += x
        self.state[1] += y
        self.state[2] += turned + drift
        transition = np.eye(5)
        transition[0, 2], transition[1, 2] = -y, x
        transition[0, 3], transition[1, 3], transition[2, 3] = -y * signed / 2.0, x * signed / 2.0, signed
        transition[0, 4], transition[1, 4] = x / scale, y / scale
        self.covariance = transition @ self.covariance @ transition.T
        self._add_noise(travel, turned)
        self._bound_position()
        return OdometryStep(ahead, left, turned + drift)

    def _add_noise(self, travel: float, turned: float) -> None:
        """Add the process noise of a step: `travel` in mm, `turned` in radians."""
        noise, meters = self._noise, travel / 1e3
        spread = noise.travel_mm**2 * meters + (noise.travel_fraction * travel) ** 2
        self.covariance[0, 0] += spread
        self.covariance[1, 1] += spread
        self.covariance[2, 2] += (
            math.radians(noise.drift_deg) ** 2 * meters + (noise.turn_fraction * turned) ** 2
        )
        self.covariance[3, 3] += (math.radians(noise.drift_change_deg_m) / 1e3) ** 2 * meters

    def shift(self, x_mm: float, y_mm: float, turn_rad: float) -> None:
        """Shift the pose without motion, after another client corrected the odometry."""
        self.state[0] += x_mm
        self.state[1] += y_mm
        self.state[2] += turn_rad

    def _bound_position(self) -> None:
        """Bound the position's standard deviation along each axis."""
        for i in (0, 1):
            if self.covariance[i, i] > self._noise.max_mm**2:
                factor = self._noise.max_mm / math.sqrt(self.covariance[i, i])
                self.covariance[i, :] *= factor
                self.covariance[:, i] *= factor

    @property
    def is_lost(self) -> bool:
        """True if most of the recent readings did not match the map."""
        return self.agreement < _LOST_AGREEMENT

    def observe_scan(self, reflectors: Reflectors, ranges: Floats, blur_rad: float = 0.0) -> None:
        """Update with a scan, (sonars,) in mm; readings that are not finite are ignored.

        `blur_rad` is the standard deviation of an additional heading error of this scan.
        """
        expected = self._ring.predict(reflectors, *self.state[:3])
        channels = _usable(expected, ranges)
        if len(channels) >= _MIN_READINGS:
            matched_fraction = self._update(expected, ranges, channels, blur_rad)
            self.agreement += _AGREEMENT_RATE * (matched_fraction - self.agreement)
            if len(channels) >= _MIN_RELOCATION_READINGS and matched_fraction >= _CONFIRMED_AGREEMENT:
                self._unconfirmed_mm = 0.0

    def observe(
        self, row: MeasurementRow, since: MotionSince = NO_MOTION, limit: JumpLimit = NO_JUMP_LIMIT
    ) -> bool:
        """Update with a landmark's measurement of the pose at a past time.

        A large innovation indicates a slip, which is accepted up to `limit`.

        Returns:
            False if the measurement is rejected; the state is unchanged then.
        """
        position_weight = math.hypot(row.cx, row.cy)
        if not row.sigma > 0.0 or not _is_unambiguous(row, position_weight, limit):
            return False
        sine, cosine = math.sin(self.state[2]), math.cos(self.state[2])
        x = -since.ahead_mm * sine - since.left_mm * cosine
        y = since.ahead_mm * cosine - since.left_mm * sine
        past_pose = self.state[:3] - (x, y, since.turned_rad)
        innovation = row.value - (row.cx * past_pose[0] + row.cy * past_pose[1] + row.ch * past_pose[2])
        if row.ch:
            innovation = math.remainder(innovation, 2.0 * math.pi * abs(row.ch))  # modulo a full turn
        turning = row.ch + row.cx * y - row.cy * x
        jacobian = np.array([row.cx, row.cy, turning, 0.0, 0.0])
        travel_variance = self._noise.travel_mm**2 * since.travel_mm / 1e3 * position_weight * position_weight
        noise = row.sigma**2 + travel_variance
        variance = float(jacobian @ self.covariance @ jacobian) + noise
        normalized = abs(innovation) / math.sqrt(variance)
        slipped = normalized > _SLIP_GATE
        if slipped and abs(innovation) > (
            limit.mm * position_weight if position_weight else limit.rad * abs(row.ch)
        ):
            return False
        if slipped:
            self._add_slip(row, innovation * innovation - variance + noise)
        cross_covariance = self.covariance @ jacobian
        gain = cross_covariance / (float(jacobian @ cross_covariance) + noise)
        if slipped:
            gain[3:] = 0.0
        self.state += gain * innovation
        retained = np.eye(len(gain)) - np.outer(gain, jacobian)
        self.covariance = retained @ self.covariance @ retained.T + noise * np.outer(gain, gain)
        return True

    def _add_slip(self, row: MeasurementRow, variance: float) -> None:
        """Add the variance of an undetected slip to the position along a row, or to the heading."""
        axis = np.array([row.cx, row.cy, 0.0] if row.cx or row.cy else [0.0, 0.0, row.ch])
        axis /= float(axis @ axis)
        self.covariance[:3, :3] += max(variance, 0.0) * np.outer(axis, axis)

    def relocate(self, reflectors: Reflectors, ranges: Floats) -> bool:
        """Try headings around the estimate on one scan, and adopt the best; return False if none is adopted.

        The position error must be small enough for a slip since the last confirmed scan: a slipping wheel
        turns a robot more than it moves it.
        """
        saved, odometry = (self.state.copy(), self.covariance.copy()), self._odometry_variances
        best, found = max(_MIN_EXPLAINED, self._explained_fraction(reflectors, ranges) + _MIN_GAIN), None
        for turn in _TRIED_TURNS_RAD:
            self.state = saved[0].copy()
            self.state[2] += turn
            explained = self._fit_state(reflectors, ranges, odometry)
            x, y = self.state[:2] - saved[0][:2]
            if explained > best and math.hypot(x, y) < _MAX_SHIFT_SIGMAS * self._lost_sigma_mm:
                best, found = explained + _TIE_MARGIN, self.state
        self.state, self.covariance = saved
        if found is None:
            return False
        self.agreement = max(self.agreement, _LOST_AGREEMENT)
        shift = found - self.state
        if abs(shift[2]) < _RELOCATED_RAD and math.hypot(shift[0], shift[1]) < _RELOCATED_MM:
            return False  # no other pose explains the scan better
        self.state[:3] = found[:3]
        self._inflate(_RELOCATED_MM, _RELOCATED_RAD)
        return True

    def adopt_if_better(
        self, pose: tuple[float, float, float], reflectors: Reflectors, ranges: Floats
    ) -> bool:
        """Adopt another pose if it explains a scan much better; return False otherwise.

        The pose is x and y in mm and the heading in degrees.
        """
        saved, odometry = (self.state.copy(), self.covariance.copy()), self._odometry_variances
        current_fit = self._fit_state(reflectors, ranges, odometry)
        self.state = np.array([pose[0], pose[1], math.radians(pose[2]), *saved[0][3:]])
        new_fit = self._fit_state(reflectors, ranges, odometry)
        found, (self.state, self.covariance) = self.state, saved
        if new_fit < max(current_fit + _MIN_ADOPTION_GAIN, _MIN_EXPLAINED):
            return False
        self.state[:3] = found[:3]
        self._inflate(_RELOCATED_MM, _RELOCATED_RAD)
        self.agreement = _LOST_AGREEMENT
        return True

    def _inflate(self, sigma_mm: float, sigma_rad: float) -> None:
        """Raise the pose's standard deviations to at least these values, and discard all correlations."""
        variances = np.diag(self.covariance)
        floor = (sigma_mm**2, sigma_mm**2, sigma_rad**2, 0.0, 0.0)
        self.covariance = np.diag(np.maximum(variances, floor))

    @property
    def _lost_sigma_mm(self) -> float:
        """Standard deviation of a lost robot's position, in mm."""
        return min(_MIN_LOST_SIGMA_MM + _SLIP_LATERAL_FRACTION * self._unconfirmed_mm, self._noise.max_mm)

    def _fit_state(self, reflectors: Reflectors, ranges: Floats, odometry: list[float]) -> float:
        """Fit the state to a scan, and return the fraction of the scan that it explains, from 0 to 1."""
        self.covariance = np.diag(
            [self._lost_sigma_mm**2, self._lost_sigma_mm**2, _TURN_STEP_RAD**2, *odometry]
        )
        for _ in range(_FIT_ITERATIONS):
            expected = self._ring.predict(reflectors, *self.state[:3])
            channels = _usable(expected, ranges)
            if len(channels) < _MIN_RELOCATION_READINGS:
                return 0.0
            self._update(expected, ranges, channels, 0.0)
        return self._explained_fraction(reflectors, ranges)

    def _explained_fraction(self, reflectors: Reflectors, ranges: Floats) -> float:
        """Return the fraction of a scan that the current state explains, from 0 to 1."""
        expected = self._ring.predict(reflectors, *self.state[:3])
        channels = _usable(expected, ranges)
        if len(channels) < _MIN_RELOCATION_READINGS:
            return 0.0
        residuals = (ranges[channels] - expected.ranges[channels]) / (
            _EXPLAINED_SIGMA * expected.sigma[channels]
        )
        return float(np.maximum(1.0 - residuals * residuals, 0.0).mean())

    def _update(
        self, expected: Prediction, ranges: Floats, channels: NDArray[np.intp], blur_rad: float
    ) -> float:
        """Update the state with one scan; return the fraction of the readings that were as predicted."""
        jacobian = np.zeros((len(channels), len(self.state)))
        jacobian[:, :3] = expected.jacobian[channels]
        innovation = ranges[channels] - expected.ranges[channels]
        noise = expected.sigma[channels] ** 2 + (jacobian[:, 2] * blur_rad) ** 2
        variance = noise + np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        normalized = np.abs(innovation) / np.sqrt(variance)
        within_gate = normalized < _GATE
        if within_gate.any():
            weight = np.minimum(1.0, _HUBER / np.maximum(normalized[within_gate], _TINY)) / noise[within_gate]
            rows = jacobian[within_gate]
            # The information form needs only 5 x 5 inverses, for any number of readings.
            scale = np.sqrt(np.diag(self.covariance))
            prior = np.linalg.inv(self.covariance / np.outer(scale, scale))
            rows = rows * scale
            posterior = np.linalg.inv(prior + rows.T @ (weight[:, None] * rows))
            self.state += scale * (posterior @ (rows.T @ (weight * innovation[within_gate])))
            self.covariance = posterior * np.outer(scale, scale)
        as_predicted = normalized < _PREDICTED_GATE
        turning = as_predicted[np.abs(jacobian[:, 2]) > _TURNING_MM]
        matched_fraction = float(as_predicted.mean())
        return (
            matched_fraction
            if len(turning) < _MIN_TURNING_READINGS
            else min(matched_fraction, float(turning.mean()))
        )


def _is_unambiguous(row: MeasurementRow, position_weight: float, limit: JumpLimit) -> bool:
    """Return True if a row is not empty, and a full turn of the heading cannot be mistaken for a shift."""
    if row.ch == 0.0 or position_weight == 0.0 or limit.mm == math.inf:
        return row.ch != 0.0 or position_weight != 0.0
    return math.pi * abs(row.ch) > limit.mm * position_weight


def _usable(expected: Prediction, ranges: Floats) -> NDArray[np.intp]:
    """Return the indices of the sonars with both a prediction and a reading."""
    return np.flatnonzero(np.isfinite(expected.sigma) & np.isfinite(ranges))
