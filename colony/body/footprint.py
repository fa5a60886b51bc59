"""Measures of a robot's footprint."""

from __future__ import annotations

import math

from colony.body.model import Body, Circle, Polygon


def radius_mm(body: Body) -> float:
    """Return the radius of the circle around the robot's center that contains its footprint."""
    match body.chassis.footprint:
        case Circle(radius_mm=radius):
            return radius
        case Polygon(corners=corners):
            return max(math.hypot(*corner) for corner in corners)
