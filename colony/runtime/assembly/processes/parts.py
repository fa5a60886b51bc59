"""The nodes of a process, built from its spec.

Each kind of part imports only what it needs, so that processes start quickly.
"""

from __future__ import annotations

import sys
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, assert_never

from colony.runtime.assembly.processes.devices import Devices
from colony.runtime.assembly.processes.shutdown import log_line
from colony.runtime.assembly.processes.spec import (
    AnnouncerPart,
    ClientsPart,
    ClockPart,
    CServerPart,
    DServerPart,
    NodePart,
    ProgramOfRun,
    PServerPart,
    RServerPart,
    read_bindings,
)
from colony.runtime.protocol.interface import Interface
from colony.runtime.protocol.messages import Node
from colony.runtime.store.store import PendingStore, Store, StoreFullError
from colony.runtime.transport.live.robot_address import Local, RobotAddress

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled
    from colony.runtime.protocol.bindings import Bindings


def serves(part: NodePart) -> bool:
    """Return True if other processes find the part by its name."""
    return not isinstance(part, (ClientsPart, AnnouncerPart))


def is_nonblocking(part: NodePart) -> bool:
    """Return True if the part's nodes handle every message without blocking.

    Images, disks and user code may block.
    """
    match part:
        case ClockPart() | RServerPart() | PServerPart() | ClientsPart():
            return True
        case CServerPart() | DServerPart() | AnnouncerPart():
            return False
        case _:
            assert_never(part)


def nodes_of(
    part: NodePart, robot_address: RobotAddress, devices: Devices | None, resources: ExitStack
) -> tuple[Node, ...]:
    """Return the nodes of a part; their other resources are added to `resources`.

    Raises:
        DiagnosticError: the compiled program is damaged, or a Python module cannot be imported or built.
        StoreError: DServer's stored data cannot be read.
        OSError: the program or its bindings cannot be read.
        ValueError: the part needs drivers, or must run on the robot's own machine, and does not.
    """
    match part:
        case ClockPart(servers=servers, stop=stop, interface=interface):
            return _clock(servers, Path(stop), interface)
        case RServerPart() | PServerPart() | CServerPart():
            return (_hardware_server(part, robot_address, devices, resources),)
        case DServerPart():
            return (_dserver(part, robot_address),)
        case ClientsPart():
            return _clients(part)
        case AnnouncerPart():
            return (_announcer(part),)
        case _:
            assert_never(part)


def _clock(servers: tuple[str, ...], stop: Path, interface: Interface) -> tuple[Node, ...]:
    from colony.runtime.frames.clock import Clock
    from colony.runtime.servers.runtime_server import RuntimeServer

    runtime = RuntimeServer()
    clock = Clock(
        servers=servers,
        on_deploy=runtime.on_deploy,
        stop_path=stop,
        report=log_line,
        interface=interface,
    )
    return clock, runtime


def _hardware_server(
    part: RServerPart | PServerPart | CServerPart,
    robot_address: RobotAddress,
    devices: Devices | None,
    resources: ExitStack,
) -> Node:
    if devices is None or not isinstance(robot_address, Local):
        raise ValueError("a server of hardware runs on the robot's own machine, with its drivers")
    robot, origin_ns, device = robot_address.robot, robot_address.directory.origin_ns(), part.device
    match part:
        case RServerPart():
            from colony.runtime.servers.rserver import RServer

            driver = devices.base(device, robot, origin_ns, resources)
            return RServer(driver)
        case PServerPart():
            from colony.runtime.servers.pserver import PServer

            return PServer(devices.proximity(device, robot, origin_ns, resources))
        case CServerPart(server=server, camera=camera):
            from colony.runtime.servers.cserver import CServer

            return CServer(devices.camera(device, robot, camera, origin_ns, resources), address=server)


def _dserver(part: DServerPart, robot_address: RobotAddress) -> Node:
    from colony.runtime.servers.dserver import DServer
    from colony.runtime.store.quarantine import damage_notes

    if not isinstance(robot_address, Local):
        raise ValueError("DServer runs on the robot's own machine")
    store, clock_id = _store(part), str(robot_address.directory.origin_ns())
    notes = partial(damage_notes, Path(part.store))
    return DServer(part.pinned_variables, store=store, clock_id=clock_id, notes=notes)


def _store(part: DServerPart) -> Store:
    """Open DServer's store; if a full disk prevents its creation, create it once there is room."""
    from colony.runtime.store.sqlite import SqliteStore

    path = Path(part.store)
    make = partial(SqliteStore, path, fsync=part.fsync, report=log_line)
    try:
        return make()
    except StoreFullError as problem:
        if path.exists():
            raise
        return PendingStore(make, problem)


def _clients(part: ClientsPart) -> tuple[Node, ...]:
    from colony.runtime.assembly.nodes import build_clients

    return build_clients(*_program(part.program), part.clients, part.program.run)


def _announcer(part: AnnouncerPart) -> Node:
    from colony.runtime.assembly.nodes import build_announcer

    with suppress(OSError):  # only Linux has this file
        Path("/proc/self/oom_score_adj").write_text("1000")
    sys.path += part.program.search_path
    return build_announcer(*_program(part.program), part.module, part.program.run)


def _program(program: ProgramOfRun) -> tuple[Compiled, Bindings]:
    from colony.execute.colonyc import read

    return read(program.file), read_bindings(Path(program.file))
