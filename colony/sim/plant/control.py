"""Control of a plant from outside the robots: their true state, their places, readings, elevators."""

from __future__ import annotations

import os
import socket
from pathlib import Path

from colony.sim.mechanism import GivenValue
from colony.sim.plant.protocol import (
    MAX_BYTES_FROM_PLANT,
    AskDoors,
    AskTruth,
    AttachControl,
    Attached,
    Doors,
    FromPlant,
    Give,
    Landed,
    MoveDoors,
    PlaceRobot,
    Refusal,
    RideElevator,
    ToPlant,
    Truth,
    pack,
    read_from_plant,
)


class PlantControl:
    """A control connection to the plant, with blocking calls. Not thread-safe.

    `began_ns` is the start time of the plant, which distinguishes it from a restarted one.

    The constructor and each method raise these exceptions:

    Raises:
        OSError: the plant does not answer within `timeout_s`.
        PlantProtocolError: the answer is invalid.
        ValueError: the plant refuses; the message is its reason.
    """

    def __init__(self, path: Path, *, timeout_s: float = 5.0) -> None:
        self._sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._sock.settimeout(timeout_s)
            self._sock.connect(os.fspath(path))
            attached = self._ask(AttachControl())
            assert isinstance(attached, Attached)
            self.began_ns = attached.began_ns
        except BaseException:
            self._sock.close()
            raise

    def truth(self, robot: str) -> Truth:
        """Return the true state of a robot."""
        answer = self._ask(AskTruth(robot=robot))
        assert isinstance(answer, Truth)
        return answer

    def place(self, robot: str, x: float, y: float, heading: float) -> None:
        """Move a robot to another pose, unnoticed by its odometry."""
        self._ask(PlaceRobot(robot=robot, x=x, y=y, heading=heading))

    def give(self, robot: str, server: str, field: str, value: GivenValue, *, t_ns: int = 0) -> None:
        """Let a field of a device read a value in base units, from a time of the plant on.

        It does so until another value, or the end of this connection. None is what the device measures.
        """
        self._ask(Give(robot=robot, server=server, field=field, t_ns=t_ns, value=value))

    def opening(self, node: str) -> float:
        """Return the opening of the doors of the elevator at a node of the robots' floor, from 0 to 1."""
        answer = self._ask(AskDoors(node=node))
        assert isinstance(answer, Doors)
        return answer.opening

    def move_doors(self, node: str, *, is_opening: bool) -> None:
        """Open the doors of the elevator at a node of the robots' floor, or close them."""
        self._ask(MoveDoors(node=node, is_opening=is_opening))

    def ride(self, node: str, floor: str) -> str:
        """Take the robots in an elevator to the floor of another map; return the node of the doors there."""
        answer = self._ask(RideElevator(node=node, floor=floor))
        assert isinstance(answer, Landed)
        return answer.node

    def close(self) -> None:
        """End the connection."""
        self._sock.close()

    def __enter__(self) -> PlantControl:
        """Return the control itself."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the connection."""
        self.close()

    def _ask(self, message: ToPlant) -> FromPlant:
        self._sock.send(pack(message))
        packet = self._sock.recv(MAX_BYTES_FROM_PLANT)
        if not packet:
            raise ConnectionError("the plant ended the connection")
        answer = read_from_plant(packet)
        if isinstance(answer, Refusal):
            raise ValueError(answer.message)
        return answer
