"""Readings that a scenario gives to the devices of a simulated robot in processes."""

from __future__ import annotations

import time
from collections.abc import Callable

from colony.robots.request import RunAbortedError
from colony.robots.scenario import ReadingChange
from colony.runtime.transport.live.robot_address import Local
from colony.sim.plant.child import plant_socket
from colony.sim.plant.control import PlantControl
from colony.sim.plant.protocol import PlantProtocolError

CHECK_INTERVAL_NS = 100_000_000
"""Nanoseconds between two checks whether the plant is still the same."""

_TIMEOUT_S = 0.5


class FieldGiver:
    """A control connection to a robot's plant that gives what fields read, until it is closed. Mutable.

    The plant gives each value at its time, by its own clock. A restarted plant is given all of them again.

    Args:
        robot_address: address of the robot.
        changes: what fields read, in chronological order.
        begin_ns: function that returns the robot's time at which the run began; None until it has begun.
            Until then, what is given at 0 holds.
    """

    def __init__(
        self, robot_address: Local, changes: tuple[ReadingChange, ...], begin_ns: Callable[[], int | None]
    ) -> None:
        self._robot_address = robot_address
        self._changes = changes
        self._begin_ns = begin_ns
        self._control: PlantControl | None = None
        self._given = 0
        self._next_check_ns = 0

    def poll(self) -> bool:
        """Give what has not been given; return False while the plant does not answer.

        Raises:
            RunAbortedError: the robot has no such field, or its plant does not simulate it.
        """
        if not self._changes:
            return True
        now_ns = time.monotonic_ns()
        try:
            if now_ns >= self._next_check_ns:
                self._next_check_ns = now_ns + CHECK_INTERVAL_NS
                self._check()
            if self._control is not None:
                self._give(self._control)
        except (OSError, PlantProtocolError):
            self.close()
        return self._control is not None

    def close(self) -> None:
        """Close the connection, which withdraws what was given."""
        control, self._control = self._control, None
        if control is not None:
            control.close()

    def _check(self) -> None:
        if self._control is None:
            socket = plant_socket(self._robot_address.directory.path)
            self._control, self._given = PlantControl(socket, timeout_s=_TIMEOUT_S), 0
        else:
            self._control.truth(self._robot_address.robot)

    def _give(self, control: PlantControl) -> None:
        """Give all changes whose times are known."""
        begin_ns = self._begin_ns()
        while self._given < len(self._changes):
            t_ns, sensor, _ = change = self._changes[self._given]
            if t_ns > 0 and begin_ns is None:
                return
            if t_ns > 0 and begin_ns is not None:
                t_ns += begin_ns + self._robot_address.directory.origin_ns()
            robot = self._robot_address.robot
            try:
                control.give(robot, sensor.server, sensor.field, change.given, t_ns=t_ns)
            except PlantProtocolError:
                raise
            except ValueError as refusal:
                raise RunAbortedError(f"`{sensor.name}` cannot be given: {refusal}") from None
            self._given += 1
