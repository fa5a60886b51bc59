"""The simulator of a run as another process: its start, the true path of the robot, given readings."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from colony.body.model import Body, radius_mm
from colony.cli.serve.processes import SERVED, SUPERVISOR, ServeSpec
from colony.files import describe
from colony.nav.maps.driven_path import DrivenPath, PeoplePaths
from colony.runs.scenario import ReadingChange
from colony.runs.spec import RunAbortedError
from colony.runtime.assembly.processes.children import last_lines
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Script
from colony.runtime.observe.summary import Travel
from colony.runtime.transport.live.robot_address import Local, RobotAddress
from colony.sim.compiling import COMPILING
from colony.sim.config import config_of
from colony.sim.plant.child import SIMULATOR, plant_socket
from colony.sim.plant.control import PlantControl
from colony.sim.plant.protocol import PlantProtocolError, Truth

if TYPE_CHECKING:
    from colony.nav.maps.building import Building
    from colony.nav.maps.world_map import WorldMap


PLANT_TIMEOUT_S = 0.5
"""Timeout in seconds for one answer of the plant to a caller that asks it repeatedly."""


def is_simulator_starting(robot_address: RobotAddress) -> bool:
    """Return True if the simulator of a robot on this machine is being started, and takes no drivers yet.

    `serve all` writes the specs of its processes first, among them that of a simulator.
    """
    if not isinstance(robot_address, Local):
        return False
    folder, running = robot_address.directory.path, robot_address.directory.running()
    if SIMULATOR not in running:
        specs = {path.stem for path in (folder / SERVED).glob("*.json")}
        if SUPERVISOR not in running or (specs and SIMULATOR not in specs):
            return False
    try:
        PlantControl(plant_socket(folder), timeout_s=PLANT_TIMEOUT_S).close()
    except (FileNotFoundError, ConnectionRefusedError):
        return True
    except (OSError, ValueError):
        pass  # it is frozen, or busy
    return False


class CompilationNotice:
    """Reports once when the simulator is being compiled, according to its log. Stateful."""

    def __init__(self, robot_address: Local, log: Path, report: Callable[[str], None]) -> None:
        self._socket = plant_socket(robot_address.directory.path)
        self._log = log
        self._report = report
        self._is_done = False

    def poll(self) -> None:
        """Read the log, unless it contained the notice before or the simulator is ready."""
        if self._is_done:
            return
        compiling = COMPILING in last_lines(self._log)
        if compiling:
            self._report(COMPILING)
        self._is_done = compiling or self._socket.exists()


def start_remarks(world: WorldMap, body: Body, start: tuple[float, float, float] | None) -> tuple[str, ...]:
    """Return what is unusual about the map or this start of a robot; see `WorldMap.remarks`.

    Returns nothing for a start at which the robot does not fit: the simulator says so.
    """
    radius = radius_mm(body)
    try:
        return world.remarks(radius, world.start(radius, start))
    except ValueError:
        return ()


OPERATOR_TIMEOUT_S = 10.0
"""Timeout in seconds for the plant to answer the operator of its elevators."""


@contextmanager
def simulated_operator(robot_address: Local, spec: ServeSpec, building: Building) -> Iterator[Script]:
    """Return the script that operates a simulated building's elevators, to be run inside the `with`.

    Raises:
        RunAbortedError: the plant does not answer.
    """
    from colony.sim.plant.elevators import RemoteElevators
    from colony.sim.world.operator import operator

    radius_mm = config_of(spec.described.body).radius_mm
    try:
        control = PlantControl(plant_socket(robot_address.directory.path), timeout_s=OPERATOR_TIMEOUT_S)
    except OSError as problem:
        raise RunAbortedError(f"the simulator does not answer: {describe(problem)}") from None
    with control:
        elevators = RemoteElevators(control, robot_address.robot, building, radius_mm)
        yield _watched(operator(elevators, seed=spec.world.seed))


def _watched(script: Script) -> Script:
    """Run the operator's script; what it does over a connection to the plant is lost with the plant.

    Raises:
        RobotConnectionError: the plant does not answer any more.
    """
    try:
        yield from script
    except OSError as problem:
        raise RobotConnectionError(f"lost the simulator: {describe(problem)}") from None


POLL_INTERVAL_NS = 100_000_000
"""Nanoseconds between two observations of the robot's true position."""


class TruthLog:
    """The true path of a simulated robot, read from the plant's control channel. Mutable.

    A restarted plant begins at the start of the map; its travel is added to that of the previous one. A
    frozen plant that resumes continues its own count. The attribute `last` is the newest observation, None
    before the first, `people` the paths of the people.
    """

    def __init__(self, robot_address: Local) -> None:
        self._socket = plant_socket(robot_address.directory.path)
        self._robot = robot_address.robot
        self._control: PlantControl | None = None
        self._plant_began_ns: int | None = None
        self._previous_travel = Travel(bumps=0, distance_mm=0.0)
        self._current_travel = Travel(bumps=0, distance_mm=0.0)
        self._next_poll_ns = 0
        self._paths: dict[str, DrivenPath] = {}
        self.people = PeoplePaths()
        self.last: Truth | None = None

    def poll(self) -> bool:
        """Observe the robot's true position if it is time; return False while the plant does not answer."""
        now_ns = time.monotonic_ns()
        if now_ns < self._next_poll_ns:
            return self._control is not None
        self._next_poll_ns = now_ns + (
            POLL_INTERVAL_NS if self._control is not None else POLL_INTERVAL_NS // 5
        )
        try:
            if self._control is None:
                self._control = PlantControl(self._socket, timeout_s=PLANT_TIMEOUT_S)
                self._switch_plant(self._control.began_ns)
            truth = self._control.truth(self._robot)
        except (OSError, ValueError):
            self.close()
            return False
        self.last = truth
        self._paths.setdefault(truth.floor, DrivenPath()).add(truth.x, truth.y)
        self.people.add(truth.floor, truth.people)
        self._current_travel = Travel(bumps=truth.bumps, distance_mm=truth.distance)
        return True

    def close(self) -> None:
        """Close the control channel; the observed path and travel remain available."""
        control, self._control = self._control, None
        if control is not None:
            control.close()

    def _switch_plant(self, began_ns: int) -> None:
        """Add the previous plant's travel to the total if another plant, begun at `began_ns`, replaced it."""
        if began_ns != self._plant_began_ns:
            self._plant_began_ns = began_ns
            self._previous_travel, self._current_travel = self.travel, Travel(bumps=0, distance_mm=0.0)

    @property
    def paths(self) -> Mapping[str, Sequence[tuple[float, float]]]:
        """The path so far on each floor, by the names of their maps; the last points are the newest."""
        return {floor: path.points for floor, path in self._paths.items()}

    @property
    def travel(self) -> Travel:
        """The distance and the bumps so far."""
        return Travel(
            bumps=self._previous_travel.bumps + self._current_travel.bumps,
            distance_mm=self._previous_travel.distance_mm + self._current_travel.distance_mm,
        )


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
