"""The operator, who presses the buttons of elevators for a robot (thesis section 5.4.6): one more script.

    scripts["operator"] = operator(elevators, world, seed=7)

It hears at DServer which elevator the robot is to take (ElevatorCall), and sees as people do where the robot
stands and how far doors are open. When the robot waits before the doors it presses the button, some time
later; when the robot has turned around in the cabin, that of the other floor; when the doors are open there
it says so (FloorReached). It acts on the simulated building; all that the robot hears of it comes by the
servers.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Generator
from typing import Any

from colony.nav.missions.elevator_calls import Call, called
from colony.nav.shared import FLOOR_REACHED
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data
from colony.sim.world.elevators import Cabin, Elevators
from colony.sim.world.world import World

DELAY_S = (2.0, 20.0)
"""Range of the time until doors open for a waiting robot, which has to be noticed, and the cabin to come."""

RIDE_S = (4.0, 15.0)
"""Range of the time from the shutting of the doors to their opening on the other floor."""

LOOK_S = 0.25
"""Seconds between two looks of the operator."""

STANDS_S = 1.5
"""A robot that has not moved for so long waits."""

_BEFORE_MM, _ASIDE_MM = 3000.0, 1200.0
"""Largest distance of a robot that waits before doors, from them and from their middle."""

_TURNED_DEG = 20.0
_STILL_MM_S, _STILL_DEG_S = 1.0, 0.5


def waits_before(cabin: Cabin, pose: tuple[float, float, float]) -> bool:
    """Return True if a robot at a pose stands in front of the doors and looks at them."""
    along, deep = cabin.inside(pose[0], pose[1])
    near = -_BEFORE_MM < deep < 0.0 and abs(along) < _ASIDE_MM
    return near and _apart_deg(pose[2], cabin.heading_deg) < _TURNED_DEG


def has_turned(cabin: Cabin, pose: tuple[float, float, float], radius_mm: float) -> bool:
    """Return True if a robot at a pose is inside and looks at the doors."""
    back = _apart_deg(pose[2], cabin.heading_deg + 180.0) < _TURNED_DEG
    return back and cabin.holds(pose[0], pose[1], radius_mm)


def operator(elevators: Elevators, world: World, *, seed: int, robot: int = 0) -> Script:
    """Take a robot along whenever it calls; never ends.

    Args:
        elevators: the elevators.
        world: the world of the robot.
        seed: seed of the delays.
        robot: its number there.
    """
    chance = random.Random(seed)
    while True:
        yield from do("DServer", data.set(FLOOR_REACHED, 0))
        while (call := (yield from called())) is None:
            yield from sleep(LOOK_S)
        delay_s, ride_s = chance.uniform(*DELAY_S), chance.uniform(*RIDE_S)
        # A robot that is wrong about its floor waits for an elevator that does not come.
        ride = _Ride(elevators, world, robot, call) if call.floor == elevators.floor else None
        if ride is not None:
            yield from ride.done(delay_s, ride_s)
        while (yield from called()) == call:
            yield from sleep(LOOK_S)
        if ride is not None:
            elevators.close(ride.there)


class _Ride:
    """A call. Mutable: `there`, the node of the doors that the operator is at.

    The ride is given up if the robot calls no more, or for another elevator.
    """

    def __init__(self, elevators: Elevators, world: World, robot: int, call: Call) -> None:
        self._elevators, self._world, self._robot = elevators, world, robot
        self._call = call
        self.there = call.node

    def done(self, delay_s: float, ride_s: float) -> Generator[Step, Any, None]:
        """Serve a call until the doors are open on the other floor, as long as the robot wants it."""
        cabin, radius_mm = self._elevators.cabin(self._call.node), self._world.config.radius_mm
        if not (yield from self._stands(lambda: waits_before(cabin, self._pose))):
            return
        yield from sleep(delay_s)
        self._elevators.open(self.there)
        while True:
            if not (yield from self._stands(lambda: has_turned(cabin, self._pose, radius_mm))):
                return
            if not (yield from self._shut()):
                return
            yield from sleep(ride_s)
            if has_turned(cabin, self._pose, radius_mm):
                break
            self._elevators.open(self.there)  # it has moved, and is to come in again
        self.there = self._elevators.ride(self.there, self._call.other)
        self._elevators.open(self.there)
        while self._elevators.opening(self.there) < 1.0:
            yield from sleep(LOOK_S)
        yield from do("DServer", data.set(FLOOR_REACHED, 1))

    @property
    def _pose(self) -> tuple[float, float, float]:
        return self._world.true_pose(self._robot)

    def _stands(self, there: Callable[[], bool]) -> Generator[Step, Any, bool]:
        """Wait until the robot has stood there for a while; False if it does not call any more."""
        stood_s = 0.0
        while stood_s < STANDS_S:
            yield from sleep(LOOK_S)
            if (yield from called()) != self._call:
                return False
            velocity, turn = self._world.speed(self._robot)
            still = abs(velocity) < _STILL_MM_S and abs(turn) < _STILL_DEG_S
            stood_s = stood_s + LOOK_S if still and there() else 0.0
        return True

    def _shut(self) -> Generator[Step, Any, bool]:
        """Press the button of the other floor until the doors are shut: a robot between opens them again."""
        while self._elevators.opening(self.there) > 0.0:
            self._elevators.close(self.there)
            yield from sleep(LOOK_S)
            if (yield from called()) != self._call:
                self._elevators.open(self.there)
                return False
        return True


def _apart_deg(one: float, other: float) -> float:
    return abs(math.remainder(one - other, 360.0))
