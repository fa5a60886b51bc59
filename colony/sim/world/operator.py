"""The operator, who presses elevator buttons for a robot (thesis section 5.4.6), as a script.

    scripts["operator"] = operator(elevators, seed=7)

The operator reads from DServer the elevator that the robot wants (ElevatorCall), and sees the robot and the
doors. When the robot waits before the doors, the operator presses the button after a delay. When the robot
has turned around in the cabin, the operator presses the button of the other floor, and when the doors are
open there, sets FloorReached. The operator acts on the simulated building, in this process or in another one
(`colony/sim/plant/elevators.py`), and communicates with the robot only through servers.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Generator
from typing import Any, Protocol

from colony.nav.missions.elevator_calls import ElevatorCall, current_call
from colony.nav.shared import FLOOR_REACHED
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data
from colony.sim.world.elevators import Cabin, Passenger

DELAY_S = (2.0, 20.0)
"""Range of the time until doors open for a waiting robot, including the operator's reaction."""

RIDE_S = (4.0, 15.0)
"""Range of the time from the closing of the doors to their opening on the other floor."""

POLL_INTERVAL_S = 0.25
"""Seconds between two observations of the operator."""

STANDSTILL_S = 1.5
"""Seconds of standstill after which a robot is considered waiting."""

_BEFORE_MM, _ASIDE_MM = 3000.0, 1200.0
"""Largest distances of a waiting robot, from the doors and sideways from their center."""

_TURNED_DEG = 20.0
_STILL_MM_S, _STILL_DEG_S = 1.0, 0.5


class OperatedElevators(Protocol):
    """The elevators of a building, as an operator uses them; `Elevators` has what each of these does."""

    @property
    def floor(self) -> str:
        """The name of the map on which the robots are."""
        ...

    def open(self, node: str) -> None:
        """Open the doors of the elevator at a node of this floor."""
        ...

    def close(self, node: str) -> None:
        """Close the doors of the elevator at a node of this floor."""
        ...

    def cabin(self, node: str) -> Cabin:
        """Return the elevator at a node of this floor."""
        ...

    def opening(self, node: str) -> float:
        """Return the opening of the doors, from 0 (shut) to 1."""
        ...

    def ride(self, node: str, floor: str) -> str:
        """Take the robots in a cabin to another floor; return the node of the doors there."""
        ...

    def passenger(self) -> Passenger:
        """Return what a person sees of the robot."""
        ...


def waits_before(cabin: Cabin, pose: tuple[float, float, float]) -> bool:
    """Return True if a robot at a pose is in front of the doors and faces them."""
    along, deep = cabin.coordinates(pose[0], pose[1])
    is_near = -_BEFORE_MM < deep < 0.0 and abs(along) < _ASIDE_MM
    return is_near and _difference_deg(pose[2], cabin.heading_deg) < _TURNED_DEG


def has_turned(cabin: Cabin, pose: tuple[float, float, float], radius_mm: float) -> bool:
    """Return True if a robot at a pose is inside the cabin and faces the doors."""
    faces_doors = _difference_deg(pose[2], cabin.heading_deg + 180.0) < _TURNED_DEG
    return faces_doors and cabin.contains(pose[0], pose[1], radius_mm)


def operator(elevators: OperatedElevators, *, seed: int) -> Script:
    """Serve every call of the building's only robot; never end.

    Args:
        elevators: the elevators.
        seed: seed of the delays.
    """
    rng = random.Random(seed)
    while True:
        yield from do("DServer", data.set(FLOOR_REACHED, 0))
        while (call := (yield from current_call())) is None:
            yield from sleep(POLL_INTERVAL_S)
        delay_s, ride_s = rng.uniform(*DELAY_S), rng.uniform(*RIDE_S)
        # A call from another floor than the robot's is not served.
        ride = _Ride(elevators, call) if call.floor == elevators.floor else None
        if ride is not None:
            yield from ride.serve(delay_s, ride_s)
        while (yield from current_call()) == call:
            yield from sleep(POLL_INTERVAL_S)
        if ride is not None:
            elevators.close(ride.node)


class _Ride:
    """A ride that a robot called. Stateful: `node` is that of the doors on the robot's current floor.

    The ride is abandoned if the robot cancels the call, or calls another elevator.
    """

    def __init__(self, elevators: OperatedElevators, call: ElevatorCall) -> None:
        self._elevators = elevators
        self._call = call
        self.node = call.node

    def serve(self, delay_s: float, ride_s: float) -> Generator[Step, Any, None]:
        """Serve the call until the doors are open on the other floor, or the call is canceled."""
        cabin = self._elevators.cabin(self._call.node)

        def is_before(robot: Passenger) -> bool:
            return waits_before(cabin, robot.pose)

        def is_inside(robot: Passenger) -> bool:
            return has_turned(cabin, robot.pose, robot.radius_mm)

        if not (yield from self._wait_for_standstill(is_before)):
            return
        yield from sleep(delay_s)
        self._elevators.open(self.node)
        while True:
            if not (yield from self._wait_for_standstill(is_inside)):
                return
            if not (yield from self._close_doors()):
                return
            yield from sleep(ride_s)
            if is_inside(self._elevators.passenger()):
                break
            self._elevators.open(self.node)  # the robot has moved, and must come in again
        self.node = self._elevators.ride(self.node, self._call.destination)
        self._elevators.open(self.node)
        while self._elevators.opening(self.node) < 1.0:
            yield from sleep(POLL_INTERVAL_S)
        yield from do("DServer", data.set(FLOOR_REACHED, 1))

    def _wait_for_standstill(self, is_waiting: Callable[[Passenger], bool]) -> Generator[Step, Any, bool]:
        """Wait until the robot has stood in place for a while; return False if the call is canceled."""
        stood_s = 0.0
        while stood_s < STANDSTILL_S:
            yield from sleep(POLL_INTERVAL_S)
            if (yield from current_call()) != self._call:
                return False
            robot = self._elevators.passenger()
            is_still = robot.speed.ground_mm_s < _STILL_MM_S and abs(robot.speed.turn_deg_s) < _STILL_DEG_S
            stood_s = stood_s + POLL_INTERVAL_S if is_still and is_waiting(robot) else 0.0
        return True

    def _close_doors(self) -> Generator[Step, Any, bool]:
        """Close the doors, again if a robot reopens them; return False if the call is canceled."""
        while self._elevators.opening(self.node) > 0.0:
            self._elevators.close(self.node)
            yield from sleep(POLL_INTERVAL_S)
            if (yield from current_call()) != self._call:
                self._elevators.open(self.node)
                return False
        return True


def _difference_deg(a: float, b: float) -> float:
    return abs(math.remainder(a - b, 360.0))
