"""The serving of a robot: one server in this process, or all of them as supervised processes."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from colony.cli.run.driver_watch import DriverWatch
from colony.cli.run.simulator import CompilationNotice, start_remarks
from colony.cli.serve.processes import SERVED, SUPERVISOR, ServeSpec, parts_of, plant_spec, processes_of
from colony.files import NO_ROOM
from colony.files import describe as describe_error
from colony.runs.spec import MisuseError, RunAbortedError
from colony.runtime.assembly.limits import LIMITS
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
    check_disk_space,
    fresh_folder,
    job_of,
    limits_part,
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
from colony.runtime.store.store import StoreError
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import in_run_directory
from colony.sim.plant.child import SIMULATOR, NoClearanceError, serve
from colony.sim.plant.servers import PlantDevices

Report = Callable[[str], None]
"""A function that takes a description of an event, of one line or several."""


def serve_one(server: str, robot_address: Local, spec: ServeSpec, report: Report) -> None:
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
            _simulate(robot_address, spec, shutdown, report)
        else:
            _serve(_part(server, robot_address, spec), robot_address, shutdown, report)


def _simulate(robot_address: Local, spec: ServeSpec, shutdown: Shutdown, report: Report) -> None:
    message = f"{SIMULATOR} of {robot_address.robot} runs; Ctrl-C ends it"
    try:
        serve(plant_spec(robot_address, spec), shutdown, ready=lambda: report(message), report=report)
    except NoClearanceError as problem:
        raise MisuseError(str(problem)) from None


def _serve(part: Part, robot_address: Local, shutdown: Shutdown, report: Report) -> None:
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
    spec: ServeSpec,
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

    if spec.world.map_path is not None:
        from colony.nav.maps.world_map import load_world

        world = load_world(spec.world.map_path)
        if spec.world.cameras:
            world.building("a camera")
        if spec.world.hazards is not None:
            world.building("--hazards")
        for remark in start_remarks(world, spec.described.body, spec.world.start):
            report(remark)
    if spec.listen is not None and spec.security is not None:
        parse_endpoint(spec.listen)
        read_security(spec.security)
    with interruptible as stop, robot_address.directory.claim(SUPERVISOR):
        folder = robot_address.directory.path / SERVED
        with in_run_directory(folder):
            jobs = [*_jobs(robot_address, spec, fresh_folder(folder))]
            if spec.listen is not None:
                jobs.append(job_of(robot_address, _part("Gateway", robot_address, spec), folder, SERVERS))
            check_disk_space(folder, len(jobs))
        children, drivers = Children(), ExitStack()
        try:
            for job in jobs:
                children.start(job)
            names = [name for job in jobs for name in (job.name, *job.others)]
            report(f"{robot_address.robot}: {', '.join(names)}; Ctrl-C ends them")
            for server in spec.devices.absent:
                report(f"{server}: no driver: nothing serves it but a server of your own")
            notice = (
                None if spec.world.map_path is None else CompilationNotice(robot_address, jobs[0].log, report)
            )
            reported = DriverDeaths(report)
            if spec.devices.hardware:
                drivers.callback(DriverWatch(robot_address, spec.devices.hardware, report).close)
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


def _jobs(robot_address: Local, spec: ServeSpec, folder: Path) -> tuple[Job, ...]:
    layout: Layout = "isolated" if spec.isolate else "composed"
    _make_state_folder(spec.state)
    return processes_of(robot_address, spec, folder, layout=layout).jobs


def _make_state_folder(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as problem:
        advice = (
            "free some space or give --state FOLDER" if problem.errno in NO_ROOM else "give --state FOLDER"
        )
        raise MisuseError(f"{describe_error(problem)}: {advice}") from None


def _part(server: str, robot_address: Local, spec: ServeSpec) -> Part:
    """Return the part for a server that runs alone."""
    if server == "Gateway":
        assert spec.listen is not None
        assert spec.security is not None
        return GatewayPart(listen=spec.listen, security=str(spec.security.absolute()))
    if server == LIMITS:
        assert spec.limits is not None
        folder = robot_address.directory.path / "limits"
        with in_run_directory(folder):
            return limits_part(spec.limits, fresh_folder(folder))
    _make_state_folder(spec.state)
    wanted = next(iter(spec.world.cameras)) if server == "CServer" else server
    return next(part for part in parts_of(robot_address, spec) if name_of(part) == wanted)
