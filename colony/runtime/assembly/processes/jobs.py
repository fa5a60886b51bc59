"""The processes of a robot or of a run, each with the spec file of its part."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from colony.execute.colonyc import SUFFIX, encode
from colony.execute.compiled import Compiled
from colony.ir.servers import DSERVER, RSERVER, RUNTIME, ServerSpec
from colony.ir.types import Value
from colony.runtime.assembly import sharing
from colony.runtime.assembly.limits import limit_bindings
from colony.runtime.assembly.processes.children import Job
from colony.runtime.assembly.processes.spec import (
    PORT,
    AnnouncerPart,
    ClientsPart,
    ClockPart,
    CServerPart,
    Device,
    DevicePart,
    DServerPart,
    GatewayPart,
    GroupPart,
    HardwareDriver,
    LimitsPart,
    Part,
    ProgramOfRun,
    PServerPart,
    RServerPart,
    SinglePart,
    Spec,
    address_spec,
    bindings_of,
    encoded_server,
    name_of,
    singles,
    write_private,
    write_spec,
)
from colony.runtime.protocol.bindings import Bindings
from colony.runtime.protocol.deployment import LIMITS_RUN, Deployment
from colony.runtime.protocol.interface import Interface
from colony.runtime.protocol.topics import client_address
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.store.store import Reserve
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotDevices:
    """The devices of a robot, each with a server, as its description has them.

    Attributes:
        base: the limits of its base; None for a robot without one.
        sonars: the number of sonars, and of infrared detectors, in its ring; None for a robot without one.
        servers: what the servers of its other devices offer.
        hardware: the drivers of real devices, by server; the plant simulates the others.
        absent: the servers of the description that no process serves; others may serve them.
    """

    base: BaseLimits | None = None
    sonars: int | None = None
    servers: tuple[ServerSpec, ...] = ()
    hardware: Mapping[str, HardwareDriver] = field(default_factory=dict)
    absent: tuple[str, ...] = ()


def server_parts(
    state_folder: Path,
    device: Device,
    devices: RobotDevices,
    *,
    cameras: Iterable[tuple[str, str]] = (),
    fsync: bool = False,
    pinned_variables: dict[str, Value] | None = None,
    interface: Interface | None = None,
    resident: Deployment | None = None,
    read_only: bool = False,
) -> tuple[Part, ...]:
    """Return the parts of all servers of a robot.

    Args:
        state_folder: folder of data that must survive the death of a server.
        device: the plant.
        devices: the devices of the robot.
        cameras: pairs of a server's name and the name of its camera.
        fsync: as in `DServerPart`.
        pinned_variables: as in `DServerPart`.
        interface: that of the robot's description, if it has one.
        resident: the deployment of the description's limits, if it has any.
        read_only: as in `ClockPart`.
    """
    hardware = devices.hardware
    served: list[Part] = []
    if devices.base is not None:
        served.append(RServerPart(device=hardware.get(RSERVER.name, device), limits=devices.base))
    if devices.sonars is not None:
        served.append(PServerPart(device=device, count=devices.sonars))
    served += [
        DevicePart(device=hardware.get(server.name, device), described=encoded_server(server))
        for server in devices.servers
    ]
    served += [CServerPart(device=device, server=server, camera=camera) for server, camera in cameras]
    frame_servers = (*map(name_of, served), *devices.absent, DSERVER.name, RUNTIME.name)
    return (
        ClockPart(
            servers=frame_servers,
            stop=str(state_folder / STOP),
            interface=interface or Interface(),
            resident=resident,
            read_only=read_only,
        ),
        *served,
        DServerPart(store=str(state_folder / STORE), fsync=fsync, pinned_variables=pinned_variables or {}),
    )


Layout = Literal["hosted", "composed", "isolated"]
"""The place of parts that cannot hold each other up: the process that starts the others, one process of their
own, or one each."""


class Processes(NamedTuple):
    """The processes of parts: the jobs to start, and the parts that run in the process that starts them."""

    jobs: tuple[Job, ...]
    hosted: tuple[SinglePart, ...] = ()


def server_processes(
    robot_address: Local, parts: Iterable[Part], folder: Path, *, simulator: str, layout: Layout
) -> Processes:
    """Return the processes of servers, and write the specs of their jobs into `folder`.

    `simulator` is the Python module to run for those of simulated devices.
    """
    together, apart = _grouped(parts)
    if layout == "composed":
        apart = (GroupPart(parts=together), *apart)
    elif layout == "isolated":
        apart = (*together, *apart)
    jobs = tuple(job_of(robot_address, part, folder, SERVERS, simulator=simulator) for part in apart)
    return Processes(jobs, together if layout == "hosted" else ())


def _grouped(parts: Iterable[Part]) -> tuple[tuple[SinglePart, ...], tuple[Part, ...]]:
    """Return the parts that can share a process, and those of other processes.

    Drivers of users, cameras and modules in Python may block, or hold the interpreter: they stay apart.
    Drivers share one with those of the same module for the same port, or as their description says.
    """
    together: list[SinglePart] = []
    apart: list[Part] = []
    lines: dict[object, list[SinglePart]] = {}
    for part in parts:
        if isinstance(part, (RServerPart, DevicePart)) and isinstance(
            hardware := part.device, HardwareDriver
        ):
            lines.setdefault(_line(name_of(part), hardware), []).append(part)
        elif isinstance(part, (CServerPart, AnnouncerPart, GatewayPart, GroupPart)) or (
            isinstance(part, ClientsPart) and not part.shared
        ):
            apart.append(part)
        else:
            together.append(part)
    apart += [line[0] if len(line) == 1 else GroupPart(parts=tuple(line)) for line in lines.values()]
    return tuple(together), tuple(apart)


def _line(server: str, hardware: HardwareDriver) -> tuple[str | int | float, ...]:
    """Return what the drivers of a process have in common, and no others."""
    port = hardware.options.get(PORT)
    if hardware.process is not None:
        return ("process", hardware.process)
    return ("server", server) if port is None else ("port", port, hardware.driver.partition(":")[0])


def client_processes(
    robot_address: RobotAddress,
    deployment: Deployment,
    compiled: Compiled,
    bindings: Bindings,
    folder: Path,
    search_path: Iterable[str] = (),
    *,
    layout: Layout = "hosted",
) -> Processes:
    """Write a program into `folder`, and return the processes of its clients and announcers.

    Clients run together where possible, unless they are isolated.
    """
    program_of_run = _write_program(deployment.run, compiled, bindings, folder, search_path)
    parts: list[Part] = [
        ClientsPart(program=program_of_run, clients=process.clients, shared=process.shared)
        for process in sharing.client_processes(compiled, isolate=False)
    ]
    parts += [AnnouncerPart(program=program_of_run, module=module) for module in compiled.python_modules]
    together, apart = _grouped(parts)
    if layout != "hosted":
        apart = (*together, *apart)
    jobs = tuple(job_of(robot_address, part, folder, CLIENTS) for part in apart)
    return Processes(jobs, together if layout == "hosted" else ())


def limits_part(compiled: Compiled, folder: Path) -> LimitsPart:
    """Write the limits of a robot's description into `folder`, and return the part of their process.

    Raises:
        OSError: a file cannot be written.
    """
    bindings = limit_bindings(compiled.robot)
    return LimitsPart(program=_write_program(LIMITS_RUN, compiled, bindings, folder))


def _write_program(
    run: str, compiled: Compiled, bindings: Bindings, folder: Path, search_path: Iterable[str] = ()
) -> ProgramOfRun:
    program = folder / f"{run}{SUFFIX}"
    write_private(program, encode(compiled))
    write_private(bindings_of(program), msgspec.json.encode(bindings))
    return ProgramOfRun(run=run, file=str(program), search_path=tuple(search_path))


def job_of(
    robot_address: RobotAddress, part: Part, folder: Path, wave: int, *, simulator: str = CHILD
) -> Job:
    """Write the spec of a process into `folder`, and return its job; its log goes there, too.

    Servers, simulated hardware and the process that clients share are essential to a run. An isolated
    client, a Python module and the driver of a real device are not: without them, frames are still decided.
    A driver is tried again however often it fails, because its device may be connected late.
    """
    name = name_of(part)
    spec = folder / f"{name.replace('/', '.')}.json"
    write_spec(spec, Spec(robot_address=address_spec(robot_address), part=part))
    parts = () if isinstance(part, GatewayPart) else singles(part)
    devices = [getattr(each, "device", None) for each in parts]
    is_real = any(isinstance(device, HardwareDriver) for device in devices)
    is_client = isinstance(part, AnnouncerPart) or (isinstance(part, ClientsPart) and not part.shared)
    clients = tuple(client_address(*c) for c in part.clients) if isinstance(part, ClientsPart) else ()
    return Job(
        name=name,
        module=simulator if any(isinstance(device, Device) for device in devices) else CHILD,
        arguments=(str(spec),),
        log=spec.with_suffix(".log"),
        wave=wave,
        essential=not is_client and not is_real,
        gives_up=not is_real,
        clients=clients,
        others=tuple(map(name_of, parts[1:])),
    )
