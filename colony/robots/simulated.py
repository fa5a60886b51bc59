"""The processes of a simulated robot: the plant in place of the hardware, and the servers that drive it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from colony.ir.types import Value
from colony.robots.driven_path import DrivenPath
from colony.runtime.assembly.processes.children import Job, last_lines
from colony.runtime.assembly.processes.jobs import HARDWARE, server_jobs, server_parts
from colony.runtime.assembly.processes.spec import Device, write_spec
from colony.runtime.observe.summary import Travel
from colony.runtime.transport.live.place import Local
from colony.sim.compiling import COMPILING
from colony.sim.plant.child import SIMULATOR, Look, PlantSpec, plant_socket
from colony.sim.plant.control import PlantControl

PLANT = "colony.sim.plant.child"
SERVERS_OF_PLANT = "colony.sim.plant.servers"


class CompilingNotice:
    """A notice that the simulator is being compiled, read from its process's `log`. Mutable."""

    def __init__(self, place: Local, log: Path, report: Callable[[str], None]) -> None:
        self._socket = plant_socket(place.directory.path)
        self._log = log
        self._report = report
        self._over = False

    def look(self) -> None:
        """Read the log until it contains the notice, or the simulator is ready."""
        if self._over:
            return
        told = COMPILING in last_lines(self._log)
        if told:
            self._report(COMPILING)
        self._over = told or self._socket.exists()


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedRobot:
    """The settings of a simulated robot.

    They are the building, the seed of the sensors' noise, the folder of data that survives the death of a
    server, servers of cameras with their viewing directions, whether DServer's data survives a loss of power,
    the start (None for the map's), the seed of the building's hazards (None for none), and the variables that
    DServer holds.
    """

    map_path: str
    seed: int
    state: Path
    cameras: Mapping[str, Look] = field(default_factory=dict)
    fsync: bool = False
    start: tuple[float, float, float] | None = None
    hazards: int | None = None
    held: Mapping[str, Value] = field(default_factory=dict)


def plant_spec(place: Local, robot: SimulatedRobot) -> PlantSpec:
    """Return the spec of the plant."""
    return PlantSpec(
        robot=place.robot,
        folder=str(place.directory.path),
        map=os.path.abspath(robot.map_path),
        seed=robot.seed,
        cameras=dict(robot.cameras),
        start=robot.start,
        hazards=robot.hazards,
    )


def device_of(place: Local) -> Device:
    """Return the hardware of a simulated robot."""
    return Device(plant=str(plant_socket(place.directory.path)))


def jobs_of(place: Local, robot: SimulatedRobot, folder: Path) -> tuple[Job, ...]:
    """Return the jobs of its processes, the slowest one first; their specs are written into `folder`."""
    told = folder / f"{SIMULATOR}.json"
    write_spec(told, plant_spec(place, robot))
    plant = Job(
        name=SIMULATOR,
        module=PLANT,
        arguments=(str(told),),
        log=told.with_suffix(".log"),
        wave=HARDWARE,
        essential=True,
    )
    parts = server_parts(
        robot.state,
        device_of(place),
        cameras=[(server, server) for server in robot.cameras],
        fsync=robot.fsync,
        held=dict(robot.held),
    )
    return (plant, *server_jobs(place, parts, folder, hardware=SERVERS_OF_PLANT))


LOOK_NS = 100_000_000
"""Nanoseconds between two observations of the robot's true place."""


class TruthLog:
    """The true way of a simulated robot, read from the plant's control channel. Mutable: the way so far.

    A restarted plant begins at the map's start; its way is added to that of the previous one. A frozen plant
    that resumes is the same one: its own count of the way continues.
    """

    def __init__(self, place: Local) -> None:
        self._socket = plant_socket(place.directory.path)
        self._robot = place.robot
        self._control: PlantControl | None = None
        self._plant: int | None = None
        self._before = Travel(bumps=0, distance_mm=0.0)
        self._now = Travel(bumps=0, distance_mm=0.0)
        self._next_ns = 0
        self._path = DrivenPath()

    def look(self) -> bool:
        """Observe the robot's true place if it is time; return False while the plant does not answer."""
        now_ns = time.monotonic_ns()
        if now_ns < self._next_ns:
            return self._control is not None
        self._next_ns = now_ns + (LOOK_NS if self._control is not None else LOOK_NS // 5)
        try:
            if self._control is None:
                self._control = PlantControl(self._socket, timeout_s=0.5)
                self._count_on(self._control.began_ns)
            truth = self._control.truth(self._robot)
        except (OSError, ValueError):
            self.close()
            return False
        self._path.add(truth.x, truth.y)
        self._now = Travel(bumps=truth.bumps, distance_mm=truth.distance)
        return True

    def close(self) -> None:
        """Close the control channel; the observations stay."""
        control, self._control = self._control, None
        if control is not None:
            control.close()

    def _count_on(self, plant: int) -> None:
        """Add a plant's travel to the total if another plant has replaced it."""
        if plant != self._plant:
            self._plant = plant
            self._before, self._now = self.travel, Travel(bumps=0, distance_mm=0.0)

    @property
    def places(self) -> Sequence[tuple[float, float]]:
        """The way so far; the last place is the newest."""
        return self._path.places

    @property
    def travel(self) -> Travel:
        """The distance and the bumps so far."""
        return Travel(
            bumps=self._before.bumps + self._now.bumps,
            distance_mm=self._before.distance_mm + self._now.distance_mm,
        )
