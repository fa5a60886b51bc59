"""The serving of a robot: one server in this process, or all of them as supervised processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from colony.execute.compiled import Compiled
from colony.files import NO_ROOM
from colony.files import describe as describe_error
from colony.robots.described import DescribedRobot
from colony.robots.driver_watch import DriverWatch
from colony.robots.request import MisuseError, RunAbortedError
from colony.robots.robot_devices import mixed_devices, real_devices, simulated_devices, with_port
from colony.robots.simulated import (
    PLANT_SERVERS,
    SERVED,
    SUPERVISOR,
    CompilationNotice,
    SimulatedRobot,
    device_of,
    plant_spec,
    processes_of,
    start_remarks,
)
from colony.runtime.assembly.limits import LIMITS, limit_deployment
from colony.runtime.assembly.processes import child
from colony.runtime.assembly.processes.children import (
    HEALTH_CHECK_INTERVAL_S,
    SHUTDOWN_GRACE_S,
    Children,
    Death,
    Job,
    RunFailedError,
    describe,
)
from colony.runtime.assembly.processes.jobs import (
    SERVERS,
    Layout,
    RobotDevices,
    check_disk_space,
    fresh_folder,
    job_of,
    limits_part,
    server_parts,
    server_processes,
)
from colony.runtime.assembly.processes.shutdown import Shutdown, on_signals
from colony.runtime.assembly.processes.spec import (
    DriverError,
    GatewayPart,
    LimitsPart,
    Part,
    Spec,
    address_spec,
    name_of,
)
from colony.runtime.protocol.interface import Interface
from colony.runtime.store.store import StoreError
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import in_run_directory
from colony.sim.plant.child import SIMULATOR, NoClearanceError, ViewDirection, serve
from colony.sim.plant.servers import PlantDevices

Report = Callable[[str], None]
"""A function that takes a description of an event, of one line or several."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The settings of served processes.

    `described` is the robot. `cameras` has the viewing directions of cameras by server name. `hazards` is the
    seed of the building's hazards, or None for no hazards, `movers` the number of other people. `start` is
    the pose where a simulated robot starts, x and y in mm and the heading in degrees, or None for that of the
    map. `interface` is that of the robot's description, if it has one, and `limits` are its limits, compiled,
    if it has any. With `hardware`, real devices are served by their drivers; with a map besides, all others
    are simulated. `port` and `baud` replace those that the body gives to drivers. With `isolate`, each
    server is a process of its own.
    """

    described: DescribedRobot
    map_path: str | None
    seed: int
    state: Path
    cameras: Mapping[str, ViewDirection] = field(default_factory=dict)
    fsync: bool = False
    listen: str | None = None
    security: Path | None = None
    hazards: int | None = None
    movers: int = 0
    start: tuple[float, float, float] | None = None
    interface: Interface | None = None
    limits: Compiled | None = None
    hardware: bool = False
    port: str | None = None
    baud: int | None = None
    isolate: bool = False

    @property
    def simulates(self) -> bool:
        """True if something is set that a simulated world alone has."""
        return bool(self.cameras or self.movers) or self.hazards is not None or self.start is not None

    @property
    def devices(self) -> RobotDevices:
        """The devices of the robot."""
        if not self.hardware:
            return simulated_devices(self.described)
        devices = real_devices(self.described) if self.map_path is None else mixed_devices(self.described)
        return devices if self.port is None else with_port(devices, self.port, self.baud)


def serve_one(server: str, robot_address: Local, settings: Settings, report: Report) -> None:
    """Run one server until a signal arrives.

    Raises:
        LiveError: the server is already running, or the run directory or the gateway's security is invalid.
        MisuseError: the robot does not fit at its start.
        DiagnosticError: the map is invalid.
        RunAbortedError: its stored data cannot be read, or nothing more can be stored.
    """
    shutdown = Shutdown()
    with on_signals(shutdown):
        if server == SIMULATOR:
            _simulate(robot_address, settings, shutdown, report)
        else:
            _serve(_part(server, robot_address, settings), robot_address, settings, shutdown, report)


def _simulate(robot_address: Local, settings: Settings, shutdown: Shutdown, report: Report) -> None:
    message = f"{SIMULATOR} of {robot_address.robot} runs; Ctrl-C ends it"
    try:
        serve(
            plant_spec(robot_address, _robot(settings)),
            shutdown,
            ready=lambda: report(message),
            report=report,
        )
    except NoClearanceError as problem:
        raise MisuseError(str(problem)) from None


def _serve(part: Part, robot_address: Local, settings: Settings, shutdown: Shutdown, report: Report) -> None:
    name = name_of(part)
    match part:
        case GatewayPart(listen=endpoint):
            does = f"listens at {endpoint}"
        case LimitsPart():
            does = "hold while no program runs"
        case _:
            does = f"listens at {robot_address.directory.socket(name)}"
    message = f"{name} of {robot_address.robot} {does}; Ctrl-C ends it"
    spec = Spec(robot_address=address_spec(robot_address), part=part)
    try:
        child.run(spec, shutdown, devices=PlantDevices(), ready=lambda: report(message))
    except (child.StartupError, DriverError, StoreError) as problem:
        raise RunAbortedError(str(problem)) from None


def serve_all(
    robot_address: Local,
    settings: Settings,
    report: Report,
    interruptible: AbstractContextManager[Callable[[], bool]],
) -> None:
    """Start all servers and the plant, and restart those that die, until `interruptible` ends.

    Real devices need no plant.

    Raises:
        LiveError: all of them are served already, or the gateway's endpoint or security is invalid.
        DiagnosticError: the map is invalid. The map and the gateway's settings are checked before anything is
            started.
        RunAbortedError: a process died and will not be restarted, unless it has the driver of a real device.
    """
    from colony.runtime.transport.live.configuration import parse_endpoint
    from colony.runtime.transport.live.security import read_security

    if settings.map_path is not None:
        from colony.nav.maps.world_map import load_world

        world = load_world(settings.map_path)
        if settings.cameras:
            world.building("a camera")
        if settings.hazards is not None:
            world.building("--hazards")
        for remark in start_remarks(world, settings.described.body, settings.start):
            report(remark)
    if settings.listen is not None and settings.security is not None:
        parse_endpoint(settings.listen)
        read_security(settings.security)
    with interruptible as stop, robot_address.directory.claim(SUPERVISOR):
        folder = robot_address.directory.path / SERVED
        with in_run_directory(folder):
            jobs = [*_jobs(robot_address, settings, fresh_folder(folder))]
            if settings.listen is not None:
                jobs.append(job_of(robot_address, _part("Gateway", robot_address, settings), folder, SERVERS))
            check_disk_space(folder, len(jobs))
        children, drivers = Children(), ExitStack()
        try:
            for job in jobs:
                children.start(job)
            names = [name for job in jobs for name in (job.name, *job.others)]
            report(f"{robot_address.robot}: {', '.join(names)}; Ctrl-C ends them")
            for server in settings.devices.absent:
                report(f"{server}: no driver: nothing serves it but a server of your own")
            notice = (
                None if settings.map_path is None else CompilationNotice(robot_address, jobs[0].log, report)
            )
            reported = DriverDeaths(report)
            if settings.devices.hardware:
                drivers.callback(DriverWatch(robot_address, settings.devices.hardware, report).close)
            while not stop():
                if notice is not None:
                    notice.poll()
                children.check(reported.add)
                time.sleep(HEALTH_CHECK_INTERVAL_S)
        except RunFailedError as problem:
            raise RunAbortedError(str(problem)) from None
        finally:
            with drivers:
                children.stop(SHUTDOWN_GRACE_S)


class DriverDeaths:
    """Reports deaths of processes; those that a driver repeats, which waits for its device, once. Mutable."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._last: dict[str, str] = {}

    def add(self, death: Death) -> None:
        """Report a death, unless it is that of a driver which says the same as at its last one."""
        job, reason = death.job, death.tail[-1] if death.tail else death.cause
        if job.gives_up or self._last.get(job.name) != reason:
            again = "" if death.pause_s is None else "; it is tried again until it works"
            self._report(describe(death) if job.gives_up else f"{job.title}: {reason}{again}")
        self._last[job.name] = reason


def _jobs(robot_address: Local, settings: Settings, folder: Path) -> tuple[Job, ...]:
    layout: Layout = "isolated" if settings.isolate else "composed"
    if settings.map_path is not None:
        return processes_of(robot_address, _robot(settings), folder, layout=layout).jobs
    _make_state_folder(settings.state)
    parts = _parts(robot_address, settings)
    if settings.limits is not None:
        parts = (*parts, limits_part(settings.limits, folder))
    return server_processes(robot_address, parts, folder, simulator=PLANT_SERVERS, layout=layout).jobs


def _make_state_folder(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as problem:
        advice = (
            "free some space or give --state FOLDER" if problem.errno in NO_ROOM else "give --state FOLDER"
        )
        raise MisuseError(f"{describe_error(problem)}: {advice}") from None


def _robot(settings: Settings) -> SimulatedRobot:
    assert settings.map_path is not None
    _make_state_folder(settings.state)
    return SimulatedRobot(
        described=settings.described,
        hardware=settings.hardware,
        map_path=settings.map_path,
        seed=settings.seed,
        state=settings.state,
        cameras=settings.cameras,
        fsync=settings.fsync,
        hazards=settings.hazards,
        movers=settings.movers,
        start=settings.start,
        interface=settings.interface,
        limits=settings.limits,
    )


def _part(server: str, robot_address: Local, settings: Settings) -> Part:
    """Return the part for a server that runs alone."""
    if server == "Gateway":
        assert settings.listen is not None
        assert settings.security is not None
        return GatewayPart(listen=settings.listen, security=str(settings.security.absolute()))
    if server == LIMITS:
        assert settings.limits is not None
        folder = robot_address.directory.path / "limits"
        with in_run_directory(folder):
            return limits_part(settings.limits, fresh_folder(folder))
    _make_state_folder(settings.state)
    wanted = next(iter(settings.cameras)) if server == "CServer" else server
    return next(part for part in _parts(robot_address, settings) if name_of(part) == wanted)


def _parts(robot_address: Local, settings: Settings) -> tuple[Part, ...]:
    return server_parts(
        settings.state,
        device_of(robot_address),
        settings.devices,
        cameras=[(name, name) for name in settings.cameras],
        fsync=settings.fsync,
        interface=settings.interface,
        resident=None if settings.limits is None else limit_deployment(settings.limits),
    )
