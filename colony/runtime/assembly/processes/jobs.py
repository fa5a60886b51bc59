"""The processes of a robot or of a run, each with the spec file of its part."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import msgspec

from colony.execute.colonyc import SUFFIX, encode
from colony.execute.compiled import Compiled
from colony.ir.types import Value
from colony.runtime.assembly.processes.children import Job
from colony.runtime.assembly.processes.spec import (
    AnnouncerPart,
    ClientsPart,
    ClockPart,
    CServerPart,
    Device,
    DServerPart,
    Part,
    ProgramOfRun,
    PServerPart,
    RServerPart,
    Spec,
    address_spec,
    bindings_of,
    name_of,
    write_private,
    write_spec,
)
from colony.runtime.assembly.sharing import client_processes
from colony.runtime.protocol.bindings import Bindings
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.fields import DSERVER, PSERVER, RSERVER, RUNTIME
from colony.runtime.protocol.interface import Interface
from colony.runtime.protocol.topics import client_address
from colony.runtime.store.reserve import Reserve
from colony.runtime.transport.live.robot_address import Local, RobotAddress

CHILD = "colony.runtime.assembly.processes.child"

CLIENTS, SERVERS, HARDWARE = range(3)
"""Shutdown waves: clients end first, then servers, which stop the robot, then its hardware."""

STORE = "DServer.sqlite"
"""Name of the file of DServer's variables, in the state folder of a robot."""

STARTUP_BYTES = 1 << 14
"""Disk space, in bytes, for the file with which a process claims its name, and for its log."""

STOP = "Clock.stop"
"""Name of the file of the emergency stop, in the same folder."""


def fresh_folder(folder: Path) -> Path:
    """Create an empty folder for this user alone, in a parent that is already private.

    Raises:
        OSError: the folder cannot be created.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(mode=0o700)
    return folder


def check_disk_space(folder: Path, processes: int) -> None:
    """Check that the disk of the run directory has space for the first writes of `processes` processes.

    Each process claims its name, and may write to its log.

    Raises:
        OSError: the disk has too little space.
    """
    reserve = Reserve(folder / "room", processes * STARTUP_BYTES)
    reserve.take()
    reserve.release()


def delete_all_but_logs(folder: Path) -> None:
    """Delete all files except non-empty logs from the folder of processes that have ended."""
    for path in folder.iterdir():
        if path.suffix != ".log" or not path.stat().st_size:
            path.unlink(missing_ok=True)


def server_parts(
    state_folder: Path,
    device: Device,
    *,
    cameras: Iterable[tuple[str, str]] = (),
    fsync: bool = False,
    pinned_variables: dict[str, Value] | None = None,
    interface: Interface | None = None,
) -> tuple[Part, ...]:
    """Return the parts of all servers of a robot.

    Args:
        state_folder: folder of data that must survive the death of a server.
        device: hardware.
        cameras: pairs of a server's name and the name of its camera.
        fsync: as in `DServerPart`.
        pinned_variables: as in `DServerPart`.
        interface: that of the robot's description, if it has one.
    """
    cameras = tuple(cameras)
    frame_servers = (
        RSERVER.name,
        PSERVER.name,
        DSERVER.name,
        RUNTIME.name,
        *(server for server, _ in cameras),
    )
    return (
        ClockPart(servers=frame_servers, stop=str(state_folder / STOP), interface=interface or Interface()),
        RServerPart(device=device),
        PServerPart(device=device),
        DServerPart(store=str(state_folder / STORE), fsync=fsync, pinned_variables=pinned_variables or {}),
        *(CServerPart(device=device, server=server, camera=camera) for server, camera in cameras),
    )


def server_jobs(
    robot_address: Local, parts: Iterable[Part], folder: Path, *, hardware: str
) -> tuple[Job, ...]:
    """Return the jobs of servers; `hardware` is the Python module to run for servers that need a driver."""
    return tuple(job_of(robot_address, part, folder, SERVERS, hardware=hardware) for part in parts)


def client_jobs(
    robot_address: RobotAddress,
    deployment: Deployment,
    compiled: Compiled,
    bindings: Bindings,
    folder: Path,
    search_path: Iterable[str] = (),
    *,
    isolate: bool = False,
) -> tuple[Job, ...]:
    """Write a program into `folder`, and return the jobs of its clients and announcers.

    Clients share a process where possible, unless `isolate` is true.
    """
    program = folder / f"{deployment.run}{SUFFIX}"
    write_private(program, encode(compiled))
    write_private(bindings_of(program), msgspec.json.encode(bindings))
    program_of_run = ProgramOfRun(run=deployment.run, file=str(program), search_path=tuple(search_path))
    parts: list[Part] = [
        ClientsPart(program=program_of_run, clients=process.clients, shared=process.shared)
        for process in client_processes(compiled, isolate=isolate)
    ]
    parts += [AnnouncerPart(program=program_of_run, module=module) for module in compiled.python_modules]
    return tuple(job_of(robot_address, part, folder, CLIENTS) for part in parts)


def job_of(robot_address: RobotAddress, part: Part, folder: Path, wave: int, *, hardware: str = CHILD) -> Job:
    """Write the spec of a process into `folder`, and return its job; its log goes there, too.

    Servers, hardware and the process that clients share are essential to a run. An isolated client and
    a Python module are not: without them, frames are still decided. Clients and Python modules need only
    one zenoh thread, because they handle one message at a time; servers receive further messages while they
    handle one.
    """
    name = name_of(part)
    spec = folder / f"{name.replace('/', '.')}.json"
    write_spec(spec, Spec(robot_address=address_spec(robot_address), part=part))
    needs_driver = isinstance(part, (RServerPart, PServerPart, CServerPart))
    dispensable = isinstance(part, AnnouncerPart) or (isinstance(part, ClientsPart) and not part.shared)
    clients = tuple(client_address(*c) for c in part.clients) if isinstance(part, ClientsPart) else ()
    return Job(
        name=name,
        module=hardware if needs_driver else CHILD,
        arguments=(str(spec),),
        log=spec.with_suffix(".log"),
        wave=wave,
        essential=not dispensable,
        one_thread=wave == CLIENTS,
        clients=clients,
    )
