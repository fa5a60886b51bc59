"""The direction along a hallway, from the orientation of a line and the goal (thesis section 5.5)."""

from __future__ import annotations


def wrapped(angle_deg: float) -> float:
    """Return an angle in (-180, 180]."""
    return 180.0 - (180.0 - angle_deg) % 360.0


def directed(orientation_deg: float, goal_deg: float) -> float:
    """Return the direction of a hallway: of the two along its orientation, the one nearer to the goal's.

    Both are headings in one frame. If both directions are 90 degrees away, the orientation itself is
    returned.

    Returns:
        `orientation_deg` or that plus 180, in (-180, 180].
    """
    ahead = abs(wrapped(goal_deg - orientation_deg))
    back = abs(wrapped(goal_deg - orientation_deg - 180.0))
    return wrapped(orientation_deg if ahead <= back else orientation_deg + 180.0)
