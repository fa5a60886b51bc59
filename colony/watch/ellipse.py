"""The ellipse of a pose on the map, from its covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass

from colony.nav.pose.pose import PoseEstimate

STANDARD_DEVIATIONS = math.sqrt(-2.0 * math.log(0.05))
"""Semiaxes in standard deviations: the robot is in the ellipse with a probability of 95 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseEllipse:
    """Where a robot is with a probability of 95 %, in the map: x east and y north.

    Attributes:
        t: time of the estimate in seconds.
        x: center, in mm.
        y: center, in mm.
        major: longer semiaxis, in mm.
        minor: shorter semiaxis, in mm.
        direction: direction of the longer semiaxis, in degrees counterclockwise from east.
        heading: heading, in degrees counterclockwise from north.
        sigma_deg: standard deviation of the heading, in degrees.
    """

    t: float
    x: float
    y: float
    major: float
    minor: float
    direction: float
    heading: float
    sigma_deg: float


def ellipse_of(pose: PoseEstimate) -> PoseEllipse:
    """Return the ellipse of a pose: along the eigenvectors of the covariance of its position."""
    middle, half = (pose.xx + pose.yy) / 2.0, math.hypot((pose.xx - pose.yy) / 2.0, pose.xy)
    return PoseEllipse(
        t=pose.t_ns / 1e9,
        x=pose.x_mm,
        y=pose.y_mm,
        major=STANDARD_DEVIATIONS * math.sqrt(max(middle + half, 0.0)),
        minor=STANDARD_DEVIATIONS * math.sqrt(max(middle - half, 0.0)),
        direction=math.degrees(math.atan2(2.0 * pose.xy, pose.xx - pose.yy) / 2.0),
        heading=pose.heading_deg,
        sigma_deg=pose.sigma_deg,
    )
