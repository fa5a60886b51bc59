"""The processes that a robot, or a run on it, consists of, each with the file that tells it what to be."""

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
    bindings_of,
    name_of,
    said_of,
    write_private,
    write_spec,
)
from colony.runtime.assembly.sharing import shared_clients
from colony.runtime.protocol.bindings import Bindings
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.fields import DSERVER, PSERVER, RSERVER, RUNTIME
from colony.runtime.protocol.topics import client_address
from colony.runtime.store.reserve import Reserve
from colony.runtime.transport.live.place import Local, Place

CHILD = "colony.runtime.assembly.processes.child"

CLIENTS, SERVERS, HARDWARE = range(3)
"""The order in which processes end: clients fall silent, servers stop the robot, its hardware goes last."""

STORE = "DServer.sqlite"
"""The file of DServer's variables, in the folder of a robot's state."""

BEGINNING_BYTES = 1 << 14
"""Bytes of disk for the claims and the log of a process: a page of each."""

STOP = "Clock.stop"
"""That of the emergency stop."""


def fresh_folder(folder: Path) -> Path:
    """An empty folder for this user alone, whose parent is one already.

    Raises:
        OSError: it cannot be made.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(mode=0o700)
    return folder


def expect_room(folder: Path, processes: int) -> None:
    """Check that the disk of the run directory has room for what so many processes write as they begin: each
    claims its name, and may say something in its log.

    Raises:
        OSError: it has not.
    """
    room = Reserve(folder / "room", processes * BEGINNING_BYTES)
    room.take()
    room.give_up()


def keep_logs(folder: Path) -> None:
    """Of the folder of processes that have ended, keep what they printed, if anything."""
    for path in folder.iterdir():
        if path.suffix != ".log" or not path.stat().st_size:
            path.unlink(missing_ok=True)


def server_parts(
    state: Path,
    device: Device,
    *,
    cameras: Iterable[tuple[str, str]] = (),
    fsync: bool = False,
    held: dict[str, Value] | None = None,
) -> tuple[Part, ...]:
    """All servers of a robot.

    Args:
        state: the folder of what survives a server's death.
        device: the hardware.
        cameras: names of servers, and of the cameras that they serve.
        fsync, held: as in `DServerPart`.
    """
    cameras = tuple(cameras)
    answering = (RSERVER.name, PSERVER.name, DSERVER.name, RUNTIME.name, *(server for server, _ in cameras))
    return (
        ClockPart(servers=answering, stop=str(state / STOP)),
        RServerPart(device=device),
        PServerPart(device=device),
        DServerPart(store=str(state / STORE), fsync=fsync, held=held or {}),
        *(CServerPart(device=device, server=server, camera=camera) for server, camera in cameras),
    )


def server_jobs(place: Local, parts: Iterable[Part], folder: Path, *, hardware: str) -> tuple[Job, ...]:
    """How servers are started; `hardware` is the module that is run for those that need a driver."""
    return tuple(job_of(place, part, folder, SERVERS, hardware=hardware) for part in parts)


def client_jobs(
    place: Place,
    deployed: Deployment,
    compiled: Compiled,
    bindings: Bindings,
    folder: Path,
    search: Iterable[str] = (),
    *,
    isolate: bool = False,
) -> tuple[Job, ...]:
    """How the clients and announcers of a program are started; the program is written into `folder`.

    Clients share a process where they can, unless `isolate`.
    """
    program = folder / f"{deployed.run}{SUFFIX}"
    write_private(program, encode(compiled))
    write_private(bindings_of(program), msgspec.json.encode(bindings))
    told = ProgramOfRun(run=deployed.run, program=str(program), search=tuple(search))
    processes = shared_clients(compiled, isolate=isolate)
    parts: list[Part] = [ClientsPart(told=told, clients=clients) for clients in processes]
    parts += [AnnouncerPart(told=told, module=module) for module in compiled.announced]
    return tuple(job_of(place, part, folder, CLIENTS) for part in parts)


def job_of(place: Place, part: Part, folder: Path, wave: int, *, hardware: str = CHILD) -> Job:
    """How a part is started; what it is told is written into `folder`, and what it prints goes there."""
    name = name_of(part)
    spec = folder / f"{name.replace('/', '.')}.json"
    write_spec(spec, Spec(place=said_of(place), part=part))
    driving = isinstance(part, (RServerPart, PServerPart, CServerPart))
    clients = tuple(client_address(*c) for c in part.clients) if isinstance(part, ClientsPart) else ()
    return Job(
        name=name,
        module=hardware if driving else CHILD,
        arguments=(str(spec),),
        log=spec.with_suffix(".log"),
        wave=wave,
        essential=wave != CLIENTS or len(clients) > 1,
        one_thread=wave == CLIENTS,
        clients=clients,
    )
