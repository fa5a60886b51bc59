"""The serving of a robot: one server in this process, or all of them as supervised processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from colony.robots.request import MisuseError, RunAbortedError
from colony.robots.simulated import CompilationNotice, SimulatedRobot, device_of, jobs_of, plant_spec
from colony.runtime.assembly.processes import child
from colony.runtime.assembly.processes.children import Children, describe
from colony.runtime.assembly.processes.jobs import (
    SERVERS,
    check_disk_space,
    fresh_folder,
    job_of,
    server_parts,
)
from colony.runtime.assembly.processes.run import HEALTH_CHECK_INTERVAL_S, SHUTDOWN_GRACE_S
from colony.runtime.assembly.processes.shutdown import Shutdown, on_signals
from colony.runtime.assembly.processes.spec import GatewayPart, Part, Spec, address_spec, name_of
from colony.runtime.protocol.interface import Interface
from colony.runtime.store.store import StoreError
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import in_run_directory
from colony.sim.plant.child import SIMULATOR, NoClearanceError, ViewDirection, serve
from colony.sim.plant.servers import PlantDevices

Report = Callable[[str], None]
"""A function that takes a description of an event, of one line or several."""

SUPERVISOR = "Supervisor"
"""The name under which `serve all` claims a robot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The settings of served processes.

    `cameras` has the viewing directions of cameras by server name. `hazards` is the seed of the building's
    hazards, or None for no hazards. `interface` is that of the robot's description, if it has one.
    """

    map_path: str | None
    seed: int
    cameras: Mapping[str, ViewDirection]
    state: Path
    fsync: bool
    listen: str | None
    security: Path | None
    hazards: int | None = None
    interface: Interface | None = None


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
    where = settings.listen if isinstance(part, GatewayPart) else robot_address.directory.socket(name)
    message = f"{name} of {robot_address.robot} listens at {where}; Ctrl-C ends it"
    spec = Spec(robot_address=address_spec(robot_address), part=part)
    try:
        child.run(spec, shutdown, devices=PlantDevices(), ready=lambda: report(message))
    except (child.StartupError, StoreError) as problem:
        raise RunAbortedError(str(problem)) from None


def serve_all(
    robot_address: Local,
    settings: Settings,
    report: Report,
    interruptible: AbstractContextManager[Callable[[], bool]],
) -> None:
    """Start all servers and the plant, and restart those that die, until `interruptible` ends.

    Raises:
        LiveError: all of them are served already, or the gateway's endpoint or security is invalid.
        DiagnosticError: the map is invalid. The map and the gateway's settings are checked before anything is
            started.
        RunAbortedError: a process died and will not be restarted.
    """
    from colony.nav.maps.stickrep.reader import load_map
    from colony.runtime.transport.live.endpoint import parse_endpoint
    from colony.runtime.transport.live.security import read_security

    assert settings.map_path is not None
    load_map(settings.map_path)
    if settings.listen is not None and settings.security is not None:
        parse_endpoint(settings.listen)
        read_security(settings.security)
    with interruptible as stop, robot_address.directory.claim(SUPERVISOR):
        robot, folder = _robot(settings), robot_address.directory.path / "served"
        with in_run_directory(folder):
            jobs = [*jobs_of(robot_address, robot, fresh_folder(folder))]
            if settings.listen is not None:
                jobs.append(job_of(robot_address, _part("Gateway", robot_address, settings), folder, SERVERS))
            check_disk_space(folder, len(jobs))
        children = Children()
        try:
            for job in jobs:
                children.start(job)
            report(f"{robot_address.robot}: {', '.join(job.name for job in jobs)}; Ctrl-C ends them")
            notice = CompilationNotice(robot_address, jobs[0].log, report)
            while not stop():
                notice.poll()
                for death in children.poll():
                    if death.pause_s is None:
                        raise RunAbortedError(describe(death))
                    report(describe(death))
                time.sleep(HEALTH_CHECK_INTERVAL_S)
        finally:
            children.stop(SHUTDOWN_GRACE_S)


def _robot(settings: Settings) -> SimulatedRobot:
    assert settings.map_path is not None
    settings.state.mkdir(mode=0o700, parents=True, exist_ok=True)
    return SimulatedRobot(
        map_path=settings.map_path,
        seed=settings.seed,
        state=settings.state,
        cameras=settings.cameras,
        fsync=settings.fsync,
        hazards=settings.hazards,
        interface=settings.interface,
    )


def _part(server: str, robot_address: Local, settings: Settings) -> Part:
    """Return the part for a server that runs alone."""
    if server == "Gateway":
        assert settings.listen is not None
        assert settings.security is not None
        return GatewayPart(listen=settings.listen, security=str(settings.security.absolute()))
    settings.state.mkdir(mode=0o700, parents=True, exist_ok=True)
    parts = server_parts(
        settings.state,
        device_of(robot_address),
        cameras=[(name, name) for name in settings.cameras],
        fsync=settings.fsync,
        interface=settings.interface,
    )
    wanted = next(iter(settings.cameras)) if server == "CServer" else server
    return next(part for part in parts if name_of(part) == wanted)
