"""The elevators of the plant, for an operator in another process (`colony/sim/world/operator.py`).

with PlantControl(plant_socket(folder)) as control:
    scripts["operator"] = operator(RemoteElevators(control, "rome", building, 400.0), seed=7)
"""

from __future__ import annotations

from colony.nav.maps.building import Building
from colony.sim.plant.control import PlantControl
from colony.sim.world.elevators import Cabin, Passenger, cabin_of
from colony.sim.world.world import Speed


class RemoteElevators:
    """The elevators of a plant. Not thread-safe; the methods raise what those of `PlantControl` raise.

    Args:
        control: the connection to the plant.
        robot: the name of the plant's only robot.
        building: the building that the plant simulates.
        radius_mm: the radius of the robot.
    """

    def __init__(self, control: PlantControl, robot: str, building: Building, radius_mm: float) -> None:
        self._control, self._robot, self._building = control, robot, building
        self._radius_mm = radius_mm

    @property
    def floor(self) -> str:
        """The name of the map on which the robot is."""
        return self._control.truth(self._robot).floor

    def open(self, node: str) -> None:
        """Open the doors of the elevator at a node of this floor."""
        self._control.move_doors(node, is_opening=True)

    def close(self, node: str) -> None:
        """Close the doors of the elevator at a node of this floor."""
        self._control.move_doors(node, is_opening=False)

    def cabin(self, node: str) -> Cabin:
        """Return the elevator at a node of this floor."""
        return cabin_of(self._building.map_named(self.floor), node)

    def opening(self, node: str) -> float:
        """Return the opening of the doors, from 0 (shut) to 1."""
        return self._control.opening(node)

    def ride(self, node: str, floor: str) -> str:
        """Take the robot in a cabin to the floor of the map `floor`; return the node of the doors there."""
        return self._control.ride(node, floor)

    def passenger(self) -> Passenger:
        """Return what a person sees of the robot."""
        truth = self._control.truth(self._robot)
        speed = Speed(truth.velocity, truth.turn, truth.sideways)
        return Passenger((truth.x, truth.y, truth.heading), speed, self._radius_mm)
