"""Progress of a robot along a straight track: odometry and landmarks in a one-dimensional Kalman filter.

The odometry gives the *reported* progress, in mm along the track. True progress is that plus an error. Over a
way d, the error grows by the odometry's scale error times d, and by the slip of the wheels; a landmark at a
known place measures the error itself. Two states, the error and the scale error, follow from that, with their
covariance. The scale error outlives a track: it is the robot's.

A wheel that slips on a metal joint loses some centimeters at once. Such a jump is no scale error, and would
spoil it: a landmark that is further off than both could explain moves the error alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

START_SIGMA_MM = 150.0
"""Standard deviation of the place at the start of a track, after a corner."""

SCALE_SIGMA = 0.012
"""Standard deviation of the odometry's scale before any landmark."""

SLIP_MM2_A_MM = 0.03
"""Growth of the error's variance a mm of way: 40 mm lost, in 50 m in the mean."""

_JUMP_SIGMAS = 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """The odometry's scale error, which is 0.01 where it says 990 mm for a meter, and its variance."""

    error: float = 0.0
    variance: float = SCALE_SIGMA**2


@dataclass(frozen=True, slots=True, kw_only=True)
class Reckoning:
    """The estimate where the reported progress is `at_mm`.

    `error_mm` is true less reported progress, with its `variance`; `scale` is the scale error with its own
    variance; `covariance` is that of the two.
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

    def moved(self, at_mm: float) -> Reckoning:
        """Return the reckoning where the reported progress is `at_mm`."""
        way = at_mm - self.at_mm
        return replace(
            self,
            at_mm=at_mm,
            error_mm=self.error_mm + self.scale.error * way,
            variance=self.variance
            + max(2.0 * way * self.covariance + way * way * self.scale.variance, 0.0)
            + SLIP_MM2_A_MM * abs(way),
            covariance=self.covariance + way * self.scale.variance,
        )

    def fixed(self, error_mm: float, variance: float) -> Reckoning:
        """Return the reckoning after a landmark measured the error, with this variance."""
        innovation = error_mm - self.error_mm
        spread = self.variance + variance
        jumped = innovation * innovation > _JUMP_SIGMAS**2 * spread
        if jumped:
            spread = innovation * innovation + variance
        gain = 1.0 - variance / spread
        scale_gain = 0.0 if jumped else self.covariance / spread
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

    def told(self, correction_mm: float) -> Reckoning:
        """Return the reckoning after the reported progress was corrected by `correction_mm`."""
        return replace(self, at_mm=self.at_mm + correction_mm, error_mm=self.error_mm - correction_mm)

    def anchored(self, error_mm: float, sigma_mm: float) -> Reckoning:
        """Return the reckoning with an error that is known by other means; learn nothing else from it."""
        return replace(self, error_mm=error_mm, variance=sigma_mm**2, covariance=0.0)

    @property
    def sigma_mm(self) -> float:
        """The standard deviation of the progress."""
        return math.sqrt(self.variance)
