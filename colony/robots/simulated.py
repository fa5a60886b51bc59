"""The processes of a simulated robot: the plant in place of the hardware, and the servers that drive it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from colony.body.model import Body, radius_mm
from colony.execute.compiled import Compiled
from colony.files import describe
from colony.ir.servers import ServerSpec
from colony.ir.types import Value
from colony.robots.described import DescribedRobot
from colony.robots.driven_path import DrivenPath, PeoplePaths
from colony.robots.request import MisuseError, RunAbortedError
from colony.robots.robot_devices import mixed_devices, real_devices, simulated_devices
from colony.runtime.assembly.limits import limit_deployment
from colony.runtime.assembly.processes.children import Job, last_lines
from colony.runtime.assembly.processes.jobs import (
    HARDWARE,
    Layout,
    Processes,
    limits_part,
    server_parts,
    server_processes,
)
from colony.runtime.assembly.processes.spec import Device, encoded_server, write_spec
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Script
from colony.runtime.observe.summary import Travel
from colony.runtime.protocol.interface import Interface
from colony.runtime.transport.live.robot_address import Local, RobotAddress
from colony.sim.compiling import COMPILING
from colony.sim.config import config_of
from colony.sim.plant.child import SIMULATOR, PlantSpec, ViewDirection, plant_socket
from colony.sim.plant.control import PlantControl
from colony.sim.plant.protocol import Truth

if TYPE_CHECKING:  # numpy, which the leader of a robot and what serves one do not need
    from colony.nav.maps.building import Building
    from colony.nav.maps.world_map import WorldMap

PLANT = "colony.sim.plant.child"
PLANT_SERVERS = "colony.sim.plant.servers"
PLANT_TIMEOUT_S = 0.5
"""Timeout in seconds for one answer of the plant to a caller that asks it repeatedly."""

SUPERVISOR = "Supervisor"
"""The name under which `serve all` claims a robot."""

SERVED = "served"
"""The name of the folder, in that of a robot, with the specs and logs of the processes of `serve all`."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedRobot:
    """The settings of a simulated robot.

    Attributes:
        map_path: the map of the building.
        floors: the names of the maps of the floors that the robot may get to by elevators, its own first;
            none if it stays on the map.
        seed: the seed of the sensors' noise.
        state: the folder of data that survives a restart of a server.
        cameras: viewing directions of cameras by server name.
        fsync: True to make DServer's data survive a power failure.
        start: the initial pose, x and y in mm and the heading in degrees; None for that of the map.
        hazards: the seed of the building's hazards; None for none.
        movers: the number of people who walk around, besides those of the hazards.
        pinned_variables: variables of DServer, with the values at which they are kept.
        interface: that of the robot's description, if it has one.
        limits: the limits of that description, compiled, if it has any.
        described: the robot.
        hardware: True if devices of the robot that have drivers are real.
    """

    described: DescribedRobot
    map_path: str
    floors: tuple[str, ...] = ()
    seed: int
    state: Path
    cameras: Mapping[str, ViewDirection] = field(default_factory=dict)
    fsync: bool = False
    start: tuple[float, float, float] | None = None
    hazards: int | None = None
    movers: int = 0
    pinned_variables: Mapping[str, Value] = field(default_factory=dict)
    interface: Interface | None = None
    limits: Compiled | None = None
    hardware: bool = False


def start_remarks(world: WorldMap, body: Body, start: tuple[float, float, float] | None) -> tuple[str, ...]:
    """Return what is unusual about the map or this start of a robot; see `WorldMap.remarks`.

    Returns nothing for a start at which the robot does not fit: the simulator says so.
    """
    radius = radius_mm(body)
    try:
        return world.remarks(radius, world.start(radius, start))
    except ValueError:
        return ()


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


def plant_spec(robot_address: Local, robot: SimulatedRobot) -> PlantSpec:
    """Return the spec of the plant.

    Raises:
        MisuseError: the simulator cannot simulate the robot.
    """
    try:
        config_of(robot.described.body)
    except ValueError as problem:
        name = robot.described.body.robot.name
        raise MisuseError(f"colony: error: `{name}` cannot be simulated: {problem}") from None
    return PlantSpec(
        robot=robot_address.robot,
        folder=str(robot_address.directory.path),
        map=os.path.abspath(robot.map_path),
        floors=robot.floors,
        seed=robot.seed,
        cameras=dict(robot.cameras),
        start=robot.start,
        hazards=robot.hazards,
        movers=robot.movers,
        body=None if robot.described.path is None else os.path.abspath(robot.described.path),
        servers=tuple(map(encoded_server, _simulated_servers(robot))),
    )


def _simulated_servers(robot: SimulatedRobot) -> Iterator[ServerSpec]:
    """Yield the servers whose devices are in the plant, apart from the base, a ring and cameras."""
    real = real_devices(robot.described).hardware if robot.hardware else {}
    return (spec for spec in simulated_devices(robot.described).servers if spec.name not in real)


def device_of(robot_address: Local) -> Device:
    """Return the hardware of a simulated robot."""
    return Device(plant=str(plant_socket(robot_address.directory.path)))


def processes_of(robot_address: Local, robot: SimulatedRobot, folder: Path, *, layout: Layout) -> Processes:
    """Return the robot's processes, the slowest first, and write their specs into `folder`."""
    spec_file = folder / f"{SIMULATOR}.json"
    write_spec(spec_file, plant_spec(robot_address, robot))
    plant = Job(
        name=SIMULATOR,
        module=PLANT,
        arguments=(str(spec_file),),
        log=spec_file.with_suffix(".log"),
        wave=HARDWARE,
        essential=True,
    )
    parts = server_parts(
        robot.state,
        device_of(robot_address),
        mixed_devices(robot.described) if robot.hardware else simulated_devices(robot.described),
        cameras=[(server, server) for server in robot.cameras],
        fsync=robot.fsync,
        pinned_variables=dict(robot.pinned_variables),
        interface=robot.interface,
        resident=None if robot.limits is None else limit_deployment(robot.limits),
    )
    if robot.limits is not None:
        parts = (*parts, limits_part(robot.limits, folder))
    servers = server_processes(robot_address, parts, folder, simulator=PLANT_SERVERS, layout=layout)
    return servers._replace(jobs=(plant, *servers.jobs))


OPERATOR_TIMEOUT_S = 10.0
"""Timeout in seconds for the plant to answer the operator of its elevators."""


@contextmanager
def simulated_operator(robot_address: Local, robot: SimulatedRobot, building: Building) -> Iterator[Script]:
    """Return the script that operates a simulated building's elevators, to be run inside the `with`.

    Raises:
        RunAbortedError: the plant does not answer.
    """
    from colony.sim.plant.elevators import RemoteElevators
    from colony.sim.world.operator import operator

    radius_mm = config_of(robot.described.body).radius_mm
    try:
        control = PlantControl(plant_socket(robot_address.directory.path), timeout_s=OPERATOR_TIMEOUT_S)
    except OSError as problem:
        raise RunAbortedError(f"the simulator does not answer: {describe(problem)}") from None
    with control:
        elevators = RemoteElevators(control, robot_address.robot, building, radius_mm)
        yield _watched(operator(elevators, seed=robot.seed))


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
