"""The progress of a robot along a straight track: a one-dimensional Kalman filter of odometry and landmarks.

The odometry gives the *reported* progress, in mm along the track. The true progress is that plus an error.
Over a distance d, the error grows by the odometry's scale error times d, and by wheel slip; a
landmark at a known position measures the error itself. So the filter has two states, the error and the scale
error, with their covariance. The scale error is kept from track to track, because it belongs to the robot.

A wheel that slips on a metal joint loses some centimeters at once. Such a jump must not change the scale
error: a landmark whose innovation exceeds a gate updates the error alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

START_SIGMA_MM = 150.0
"""Standard deviation of the position at the start of a track, after a corner."""

SCALE_SIGMA = 0.012
"""Initial standard deviation of the odometry's scale error."""

SLIP_MM2_PER_MM = 0.03
"""Growth of the error's variance per mm traveled: 40 mm after 50 m."""

_JUMP_SIGMAS = 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """The odometry's scale error, 0.01 if it reports 990 mm for a meter, and its variance."""

    error: float = 0.0
    variance: float = SCALE_SIGMA**2


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackEstimate:
    """The estimate at the reported progress `at_mm`.

    `error_mm` is the true progress minus the reported one, with its `variance`; `scale` is the scale error
    with its own variance; `covariance` is the covariance of both errors.
    """

    at_mm: float = 0.0
    error_mm: float = 0.0
    variance: float = START_SIGMA_MM**2
    covariance: float = 0.0
    scale: Scale = Scale()

    @property
    def progress_mm(self) -> float:
        """The best estimate of the true progress."""
        return self.at_mm + self.error_mm

    def moved(self, at_mm: float) -> TrackEstimate:
        """Return the prediction at the reported progress `at_mm`."""
        travel_mm = at_mm - self.at_mm
        return replace(
            self,
            at_mm=at_mm,
            error_mm=self.error_mm + self.scale.error * travel_mm,
            variance=self.variance
            + max(2.0 * travel_mm * self.covariance + travel_mm * travel_mm * self.scale.variance, 0.0)
            + SLIP_MM2_PER_MM * abs(travel_mm),
            covariance=self.covariance + travel_mm * self.scale.variance,
        )

    def updated(self, error_mm: float, variance: float) -> TrackEstimate:
        """Return the estimate updated with a landmark's measurement of the error."""
        innovation = error_mm - self.error_mm
        innovation_variance = self.variance + variance
        jumped = innovation * innovation > _JUMP_SIGMAS**2 * innovation_variance
        if jumped:
            innovation_variance = innovation * innovation + variance
        gain = 1.0 - variance / innovation_variance
        scale_gain = 0.0 if jumped else self.covariance / innovation_variance
        learned = Scale(
            error=self.scale.error + scale_gain * innovation,
            variance=self.scale.variance - scale_gain * self.covariance,
        )
        return replace(
            self,
            error_mm=self.error_mm + gain * innovation,
            variance=gain * variance,
            covariance=0.0 if jumped else (1.0 - gain) * self.covariance,
            scale=learned,
        )

    def corrected(self, correction_mm: float) -> TrackEstimate:
        """Return the estimate after the reported progress was corrected by `correction_mm`."""
        return replace(self, at_mm=self.at_mm + correction_mm, error_mm=self.error_mm - correction_mm)

    def anchored(self, error_mm: float, sigma_mm: float) -> TrackEstimate:
        """Return the estimate with an error from another source; the scale error is kept."""
        return replace(self, error_mm=error_mm, variance=sigma_mm**2, covariance=0.0)

    @property
    def sigma_mm(self) -> float:
        """The standard deviation of the progress."""
        return math.sqrt(self.variance)
