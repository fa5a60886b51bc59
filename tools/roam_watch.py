"""What becomes of a robot that roams, step by step. `roams` makes the runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from colony.ir.frame import Frame, Outcome
from colony.nav.maps.free_space import Place
from colony.sim.devices.sensors import is_inside
from colony.sim.world.world import World

CIRCLE_MM, STUCK_S = 500.0, 40.0
"""A robot that has not left a circle of this radius for as long is stuck."""

LARGEST_HOLE_MM = 1500.0
"""Longest side of a hole."""


class Case(NamedTuple):
    """One run: a robot with its behavior on a floor, from a place of the seed."""

    robot: str
    behavior: str
    floor: str
    seed: int


@dataclass(slots=True, kw_only=True)
class Roam:
    """What became of a run. Mutable: grows with each step.

    Attributes:
        way_mm: the way driven.
        contacts, fastest_mm_s: collisions, and the robot's own greatest speed in one.
        pushed_s: the longest time for which a command drove on into what touched it.
        touched_s: the longest contact.
        still_s: the longest time without leaving a circle of `CIRCLE_MM`.
        rams: frames that knew of a pressed bumper or a cliff, and drove on toward it.
        edges: how often it came to an edge, as its cliff sensors say.
        beyond_mm: how far the foremost part of its hull was beyond an edge.
        fell: whether a wheel, or the middle of the robot, was ever over a hole.
    """

    case: Case
    way_mm: float = 0.0
    contacts: int = 0
    fastest_mm_s: float = 0.0
    pushed_s: float = 0.0
    touched_s: float = 0.0
    still_s: float = 0.0
    rams: int = 0
    edges: int = 0
    beyond_mm: float = 0.0
    fell: bool = False

    @property
    def got_away(self) -> bool:
        """Whether it never stayed where it was."""
        return self.still_s < STUCK_S


class Watcher:
    """Watches a robot step by step. Mutable.

    Args:
        roam: takes what became of the run.
        world: the world, in which the robot is number 0.
        wheel_base_mm: the distance between its wheels.
        radius: the radius of its hull in mm.
    """

    def __init__(self, roam: Roam, world: World, wheel_base_mm: float, radius: float) -> None:
        self._roam, self._world = roam, world
        self._wheels = ((0.0, 0.0), (0.0, wheel_base_mm / 2.0), (0.0, -wheel_base_mm / 2.0))
        self._rim = tuple((float(back), 0.0) for back in range(0, round(radius), 5))
        self._radius = radius
        self._near = [(*hole.mean(axis=0).tolist(), radius + LARGEST_HOLE_MM) for hole in world.holes]
        self._velocity = 0.0
        self._touch_s = self._push_s = 0.0
        self._at_edge = False
        self._last_s = self._moved_s = 0.0
        self._place = world.true_pose(0)[:2]

    def take(self, frame: Frame, outcome: Outcome) -> None:
        """Take a frame and what was decided in it."""
        values = outcome.decisions[0].values
        self._velocity = 0.0 if values is None else float(values[0])
        cliff = frame.readings.get("cliff")
        is_edge = isinstance(cliff, tuple) and any(cliff)
        self._roam.edges += is_edge and not self._at_edge
        self._at_edge = is_edge
        self._roam.rams += self._velocity > 0.0 and (is_edge or frame.readings.get("front_bumper") is True)

    def step(self) -> None:
        """Take a step of the world."""
        world, roam = self._world, self._roam
        now_s = world.elapsed_ns / 1e9
        dt_s, self._last_s = now_s - self._last_s, now_s
        front, rear = world.bumper(0)
        pushes = (front and self._velocity > 0.0) or (rear and self._velocity < 0.0)
        self._touch_s = self._touch_s + dt_s if front or rear else 0.0
        self._push_s = self._push_s + dt_s if pushes else 0.0
        roam.touched_s = max(roam.touched_s, self._touch_s)
        roam.pushed_s = max(roam.pushed_s, self._push_s)
        self._see_floor()
        place = world.true_pose(0)[:2]
        if math.dist(place, self._place) > CIRCLE_MM:
            self._place, self._moved_s = place, now_s
        roam.still_s = max(roam.still_s, now_s - self._moved_s)

    def finish(self) -> None:
        """Take what the world has counted."""
        world, roam = self._world, self._roam
        roam.way_mm, roam.contacts, roam.fastest_mm_s = (
            world.distance(0),
            world.bumps(0),
            world.contact_speed(0),
        )

    def _see_floor(self) -> None:
        place = self._world.true_pose(0)[:2]
        if not any(math.dist(place, (x, y)) < reach for x, y, reach in self._near):
            return
        self._roam.fell |= any(map(self._is_over, self._wheels))
        if self._is_over((self._radius, 0.0)):
            beyond = next(
                (back for back, _ in self._rim if not self._is_over((self._radius - back, 0.0))), 0.0
            )
            self._roam.beyond_mm = max(self._roam.beyond_mm, beyond)

    def _is_over(self, place: Place) -> bool:
        """Whether a place of the robot, mm ahead and to the left, is over a hole."""
        x, y, heading = self._world.true_pose(0)
        sine, cosine = math.sin(math.radians(heading)), math.cos(math.radians(heading))
        at = (x - place[0] * sine - place[1] * cosine, y + place[0] * cosine - place[1] * sine)
        return any(is_inside(hole, *at) for hole in self._world.holes)
