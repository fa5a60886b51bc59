"""The direction of a hallway, from the orientation of a line and the goal (thesis section 5.5)."""

from __future__ import annotations


def wrap_deg(angle_deg: float) -> float:
    """Wrap an angle to (-180, 180]."""
    return 180.0 - (180.0 - angle_deg) % 360.0


def hallway_direction(orientation_deg: float, goal_deg: float) -> float:
    """Return the one of the two directions along a hallway that is nearer to the goal's direction.

    All angles are headings in the same frame. If both directions are 90 degrees off, the orientation itself
    is returned.

    Returns:
        `orientation_deg` or `orientation_deg` + 180, in (-180, 180].
    """
    forward_error = abs(wrap_deg(goal_deg - orientation_deg))
    reverse_error = abs(wrap_deg(goal_deg - orientation_deg - 180.0))
    return wrap_deg(orientation_deg if forward_error <= reverse_error else orientation_deg + 180.0)
