"""The true path of the robot, frame by frame, as the reference for sightings."""

from __future__ import annotations

from bisect import bisect_right

from colony.nav.maps.stickrep.model import Pose


class TruePath:
    """The true path of a robot. Mutable."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._poses: list[Pose] = []

    def add(self, t_ns: int, pose: Pose) -> None:
        """Add the robot's pose in a frame; times must increase from call to call."""
        self._times.append(t_ns)
        self._poses.append(pose)

    def at(self, t_ns: int) -> Pose:
        """Return the pose in the latest frame up to `t_ns`, or in the first frame if all are later.

        Raises:
            ValueError: there is no pose yet.
        """
        if not self._poses:
            raise ValueError("no pose was added yet")
        return self._poses[max(bisect_right(self._times, t_ns) - 1, 0)]
