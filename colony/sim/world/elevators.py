"""The elevators of a building: sliding doors, a cabin behind them, and rides from floor to floor.

    floors = {floor.name: draw(Hazards(), floor, seed=7 + n) for n, floor in enumerate(building.maps)}
    elevators = Elevators(world, building, floors, "msu_engineering_3")
    elevators.open("acs.elev.L")          # a person presses the button
    elevators.advance(0.05)               # after each step of the world

An elevator's edge is a pair of sliding doors, with a cabin 2 m wide and 1.8 m deep behind them. Until the
doors are first opened, the edge on the map takes their place. Doors do not close on a robot: if a robot
stands between them, they open again, like doors with a light barrier. The operator
(`colony/sim/world/operator.py`) presses the buttons (thesis section 5.4.6).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.building import Building, Landing
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import walls_of
from colony.sim.hazards.scenery import Scenery
from colony.sim.world.world import Speed, World

CABIN_WIDTH_MM, CABIN_DEPTH_MM = 2000.0, 1800.0
SLIDE_S = 2.5
"""Time in seconds for doors to open or close."""

_BARRIER_MM = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Cabin:
    """An elevator on one floor: doors from (x0_mm, y0_mm) to (x1_mm, y1_mm), the cabin to their left."""

    x0_mm: float
    y0_mm: float
    x1_mm: float
    y1_mm: float

    @property
    def width_mm(self) -> float:
        """The width of the doors in mm."""
        return math.hypot(self.x1_mm - self.x0_mm, self.y1_mm - self.y0_mm)

    @property
    def heading_deg(self) -> float:
        """The direction into the cabin, in degrees."""
        return math.degrees(math.atan2(self.y1_mm - self.y0_mm, self.x1_mm - self.x0_mm)) % 360.0

    def coordinates(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return the distances of a point from the center of the doors, along them and into the cabin."""
        ex, ey = self._along
        dx, dy = x_mm - (self.x0_mm + self.x1_mm) / 2, y_mm - (self.y0_mm + self.y1_mm) / 2
        return dx * ex + dy * ey, dy * ex - dx * ey

    def point_at(self, along_mm: float, deep_mm: float) -> tuple[float, float]:
        """Return the point at these distances from the center of the doors; the inverse of `coordinates`."""
        ex, ey = self._along
        x, y = (self.x0_mm + self.x1_mm) / 2, (self.y0_mm + self.y1_mm) / 2
        return x + along_mm * ex - deep_mm * ey, y + along_mm * ey + deep_mm * ex

    @property
    def _along(self) -> tuple[float, float]:
        return (self.x1_mm - self.x0_mm) / self.width_mm, (self.y1_mm - self.y0_mm) / self.width_mm

    def contains(self, x_mm: float, y_mm: float, radius_mm: float) -> bool:
        """Return True if a round object at this point is completely inside the cabin."""
        along, deep = self.coordinates(x_mm, y_mm)
        is_between_walls = abs(along) <= CABIN_WIDTH_MM / 2 - radius_mm
        return is_between_walls and radius_mm <= deep <= CABIN_DEPTH_MM - radius_mm

    def walls(self, opening: float) -> list[tuple[float, float, float, float]]:
        """Return the walls of the cabin and the leaves of its doors; `opening` is from 0 (shut) to 1."""
        half, side = self.width_mm / 2, max(CABIN_WIDTH_MM, self.width_mm) / 2
        corners = [(-half, 0.0), (-side, 0.0), (-side, CABIN_DEPTH_MM)]
        corners += [(-along, deep) for along, deep in reversed(corners)]
        gap = half * opening
        leaves = [((-half, 0.0), (-gap, 0.0)), ((gap, 0.0), (half, 0.0))]
        lines = [*pairwise(corners), *leaves]
        return [(*self.point_at(*start), *self.point_at(*end)) for start, end in lines if start != end]


def cabin_of(floor: Map, node: str) -> Cabin:
    """Return the elevator whose edge begins at a node.

    Raises:
        ValueError: no elevator begins there.
    """
    names = [n.name for ring in floor.rings for n in ring.nodes]
    walls = walls_of(floor)
    if node not in names or walls.kinds[names.index(node)] is not EdgeKind.ELEVATOR:
        elevator_nodes = [
            name for name, kind in zip(names, walls.kinds, strict=True) if kind is EdgeKind.ELEVATOR
        ]
        raise ValueError(
            f"`{floor.name}` has no elevator at `{node}`; it has {', '.join(elevator_nodes) or 'none'}"
        )
    x0, y0, x1, y1 = walls.segments[names.index(node)].tolist()
    return Cabin(x0_mm=x0, y0_mm=y0, x1_mm=x1, y1_mm=y1)


class Passenger(NamedTuple):
    """A robot as a person at an elevator sees it: pose in mm and degrees, speed, and radius."""

    pose: tuple[float, float, float]
    speed: Speed
    radius_mm: float


@dataclass(frozen=False, slots=True, kw_only=True)
class _Doors:
    """The doors of a cabin. Mutable: `opening` is from 0 (shut) to 1."""

    cabin: Cabin
    opening: float = 0.0
    should_open: bool = False

    @property
    def target(self) -> float:
        return 1.0 if self.should_open else 0.0


class Elevators:
    """The elevators of the floor on which a world's robots are. Mutable; it also changes the world.

    Args:
        world: the robots, on `floor`.
        building: the building, with its elevators.
        sceneries: the sceneries of the floors, by the names of their maps.
        floor: the name of the map on which the robots are.

    Raises:
        ValueError: a floor has no scenery.
    """

    def __init__(
        self, world: World, building: Building, sceneries: Mapping[str, Scenery], floor: str
    ) -> None:
        missing = [m.name for m in building.maps if m.name not in sceneries]
        if missing or floor not in sceneries:
            found = ", ".join(missing) or floor
            raise ValueError(f"floors without scenery: {found}; expected one for each map")
        self._world = world
        self._building = building
        self._sceneries = sceneries
        self.floor = floor
        self._doors: dict[str, _Doors] = {}

    def open(self, node: str) -> None:
        """Open the doors of the elevator at a node of this floor.

        Raises:
            ValueError: no elevator begins there.
        """
        self._doors_at(node).should_open = True

    def close(self, node: str) -> None:
        """Close the doors of the elevator at a node of this floor."""
        self._doors_at(node).should_open = False

    def cabin(self, node: str) -> Cabin:
        """Return the elevator at a node of this floor.

        Raises:
            ValueError: no elevator begins there.
        """
        return self._doors_at(node).cabin

    def passenger(self, robot: int = 0) -> Passenger:
        """Return what a person sees of a robot."""
        world = self._world
        return Passenger(world.true_pose(robot), world.speed(robot), world.configs[robot].radius_mm)

    def opening(self, node: str) -> float:
        """Return the opening of the doors, from 0 (shut) to 1."""
        return self._doors[node].opening if node in self._doors else 0.0

    def advance(self, dt_s: float) -> None:
        """Move the doors for `dt_s` seconds; call this after each step of the world."""
        moved = False
        for doors in self._doors.values():
            if not doors.should_open and doors.opening > 0.0 and self._is_robot_between(doors.cabin):
                doors.should_open = True
            step = dt_s / SLIDE_S
            opening = doors.opening + min(max(doors.target - doors.opening, -step), step)
            moved |= opening != doors.opening
            doors.opening = opening
        if moved:
            self._world.rebuild(*self._walls())

    def ride(self, node: str, floor: str) -> str:
        """Take the robots in a cabin to the floor of the map `floor`; return the node of the doors there.

        The doors there are shut, too.

        Raises:
            ValueError: the elevator does not lead there, its doors are not shut, or a robot is not inside.
        """
        doors = self._doors_at(node)
        landing = self._landing(node, floor)
        if doors.opening > 0.0:
            raise ValueError(f"the doors at `{node}` are open; close them before the ride")
        new_cabin = cabin_of(self._building.map_named(floor), landing)
        poses = [self._pose_after_ride(doors.cabin, new_cabin, robot) for robot in range(len(self._world))]
        previous = self.floor, self._doors
        self.floor, self._doors = floor, {landing: _Doors(cabin=new_cabin)}
        try:
            walls, silent = self._walls()
            scenery = replace(self._sceneries[floor], walls=walls, silent=silent)
            self._world.enter(scenery, poses)
        except ValueError:
            self.floor, self._doors = previous
            raise
        return landing

    def _doors_at(self, node: str) -> _Doors:
        if node not in self._doors:
            self._doors[node] = _Doors(cabin=cabin_of(self._building.map_named(self.floor), node))
        return self._doors[node]

    def _landing(self, node: str, floor: str) -> str:
        here = Landing(self.floor, node)
        for ride in self._building.rides:
            for start, end in ((ride.first, ride.second), (ride.second, ride.first)):
                if start == here and end.map == floor:
                    return end.node
        raise ValueError(f"the elevator at `{node}` of `{self.floor}` does not lead to `{floor}`")

    def _is_robot_between(self, cabin: Cabin) -> bool:
        for (x, y, _), config in zip(self._world.true_poses.tolist(), self._world.configs, strict=True):
            along, deep = cabin.coordinates(x, y)
            aside = max(abs(along) - cabin.width_mm / 2, 0.0)
            if math.hypot(aside, deep) < config.radius_mm + _BARRIER_MM:
                return True
        return False

    def _pose_after_ride(self, cabin: Cabin, new_cabin: Cabin, robot: int) -> tuple[float, float, float]:
        """Return the pose of a robot after the ride, at the same position in the cabin."""
        pose, radius = self._world.true_pose(robot), self._world.configs[robot].radius_mm
        along, deep = cabin.coordinates(pose.x_mm, pose.y_mm)
        if not cabin.contains(pose.x_mm, pose.y_mm, radius):
            position = f"{deep:.0f} mm behind its doors and {along:.0f} mm aside"
            raise ValueError(f"robot {robot} is not in the cabin: {position}")
        return *new_cabin.point_at(along, deep), pose.heading_deg + new_cabin.heading_deg - cabin.heading_deg

    def _walls(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the walls of this floor, with cabins in place of the edges of used doors."""
        scenery = self._sceneries[self.floor]
        walls, silent = scenery.walls, scenery.silent
        for doors in self._doors.values():
            cabin = doors.cabin
            edge = (walls == (cabin.x0_mm, cabin.y0_mm, cabin.x1_mm, cabin.y1_mm)).all(axis=1)
            cabin_walls = np.array(cabin.walls(doors.opening))
            walls, silent = np.vstack([walls[~edge], cabin_walls]), silent[~edge]
            silent = np.append(silent, np.zeros(len(cabin_walls), dtype=np.bool_))
        return walls, silent
