"""The nodes of a process, built from its spec.

Each kind of part imports only what it needs, so that processes start quickly.
"""

from __future__ import annotations

import sys
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, assert_never

from colony.runtime.assembly.processes.shutdown import log_line
from colony.runtime.assembly.processes.spec import (
    AnnouncerPart,
    ClientsPart,
    ClockPart,
    CServerPart,
    DevicePart,
    DevicesPart,
    DriverFactory,
    DServerPart,
    HardwareDriver,
    LimitsPart,
    ProgramOfRun,
    PServerPart,
    RServerPart,
    SinglePart,
    read_bindings,
)
from colony.runtime.protocol.messages import Node
from colony.runtime.store.store import PendingStore, Store, StoreFullError
from colony.runtime.transport.live.outbox import Report
from colony.runtime.transport.live.robot_address import Local, RobotAddress

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled
    from colony.runtime.protocol.bindings import Bindings


def nodes_of(
    part: SinglePart,
    robot_address: RobotAddress,
    devices: DriverFactory | None,
    resources: ExitStack,
    report: Report = log_line,
) -> tuple[Node, ...]:
    """Return the nodes of a part; their other resources are added to `resources`.

    `report` takes a sentence about each problem that they survive.

    Raises:
        DiagnosticError: the compiled program is damaged, or a Python module cannot be imported or built.
        DriverError: the driver of a real device cannot be imported or made.
        StoreError: DServer's stored data cannot be read.
        OSError: the program or its bindings cannot be read.
        ValueError: the part needs drivers, or must run on the robot's own machine, and does not.
    """
    match part:
        case ClockPart():
            return _clock(part, report)
        case RServerPart() | PServerPart() | CServerPart() | DevicePart():
            return (_device_server(part, robot_address, devices, resources, report),)
        case DServerPart():
            return (_dserver(part, robot_address, report),)
        case ClientsPart():
            return _clients(part)
        case LimitsPart(program=program):
            return _limits(program)
        case AnnouncerPart():
            return (_announcer(part),)
        case _:
            assert_never(part)


def _clock(part: ClockPart, report: Report) -> tuple[Node, ...]:
    from colony.runtime.frames.clock import Clock
    from colony.runtime.servers.runtime_server import RuntimeServer

    runtime = RuntimeServer()
    clock = Clock(
        servers=part.servers,
        on_deploy=runtime.on_deploy,
        stop_path=Path(part.stop),
        report=report,
        interface=part.interface,
        resident=part.resident,
        read_only=part.read_only,
    )
    return clock, runtime


def _device_server(
    part: DevicesPart,
    robot_address: RobotAddress,
    devices: DriverFactory | None,
    resources: ExitStack,
    report: Report,
) -> Node:
    if not isinstance(robot_address, Local):
        raise ValueError("a server of a device runs on the robot's own machine")
    robot, origin_ns = robot_address.robot, robot_address.directory.origin_ns()
    if isinstance(part.device, HardwareDriver):
        return _hardware_server(part, part.device, robot_address, resources, report)
    if devices is None:
        raise ValueError("a server of a simulated device runs with the drivers of the simulator")
    match part:
        case RServerPart(limits=limits):
            from colony.runtime.servers.rserver import RServer

            return RServer(devices.base(part.device, robot, limits, origin_ns, resources))
        case PServerPart(device=device, count=count):
            from colony.runtime.servers.pserver import PServer

            return PServer(devices.proximity(device, robot, count, origin_ns, resources))
        case CServerPart(device=device, server=server, camera=camera):
            from colony.runtime.servers.cserver import CServer

            return CServer(devices.camera(device, robot, camera, origin_ns, resources), address=server)
        case DevicePart():
            from colony.runtime.kit.devices import device_server

            offered = part.server
            driver = devices.device(part.device, robot, offered.name, resources)
            return device_server(offered, driver, report, is_expected=True)


def _hardware_server(
    part: DevicesPart, hardware: HardwareDriver, robot_address: Local, resources: ExitStack, report: Report
) -> Node:
    """Return the server of a real device.

    Raises:
        DriverError: see `hardware.load_driver`.
    """
    from colony.ir.servers import OMNIDIRECTIONAL_RSERVER, RSERVER
    from colony.runtime.assembly.processes.hardware import (
        HardwareBase,
        close_driver,
        device_driver,
        load_driver,
    )
    from colony.runtime.kit.read_only import BaseReader, listening_server

    driver = load_driver(hardware, robot_address)
    match part:
        case RServerPart(limits=limits):
            from colony.runtime.servers.rserver import RServer

            origin_ns = robot_address.directory.origin_ns()
            base = HardwareBase(driver, limits, hardware, origin_ns=origin_ns, report=report)
            resources.callback(base.close)
            if hardware.listens:
                spec = OMNIDIRECTIONAL_RSERVER if limits.sideways > 0.0 else RSERVER
                return listening_server(spec, BaseReader(base), driver, report)
            return RServer(base)
        case DevicePart():
            from colony.runtime.kit.devices import DeviceReader, device_server

            bound = (command.name for command in part.server.commands if command.is_bound)
            checked = device_driver(driver, hardware, bound)
            resources.callback(close_driver, driver, report)
            if hardware.listens:
                reader = DeviceReader(part.server, checked, report)
                return listening_server(part.server, reader, driver, report)
            return device_server(part.server, checked, report, is_expected=True)
        case _:
            raise ValueError(f"{type(part).__name__} has no driver of users")


def _dserver(part: DServerPart, robot_address: RobotAddress, report: Report) -> Node:
    from colony.runtime.servers.dserver import DServer
    from colony.runtime.store.sqlite import damage_notes

    if not isinstance(robot_address, Local):
        raise ValueError("DServer runs on the robot's own machine")
    store, clock_id = _store(part, report), str(robot_address.directory.origin_ns())
    notes = partial(damage_notes, Path(part.store))
    return DServer(part.pinned_variables, store=store, clock_id=clock_id, notes=notes)


def _store(part: DServerPart, report: Report) -> Store:
    """Open DServer's store; if a full disk prevents its creation, create it once there is room."""
    from colony.runtime.store.sqlite import SqliteStore

    path = Path(part.store)
    make = partial(SqliteStore, path, fsync=part.fsync, report=report)
    try:
        return make()
    except StoreFullError as problem:
        if path.exists():
            raise
        return PendingStore(make, problem)


def _clients(part: ClientsPart) -> tuple[Node, ...]:
    from colony.runtime.assembly.nodes import build_clients

    return build_clients(*read_program(part.program), part.clients, part.program.run)


def _limits(program: ProgramOfRun) -> tuple[Node, ...]:
    from colony.runtime.assembly.limits import limit_nodes

    return limit_nodes(*read_program(program))


def _announcer(part: AnnouncerPart) -> Node:
    from colony.runtime.assembly.nodes import build_announcer

    with suppress(OSError):  # only Linux has this file
        Path("/proc/self/oom_score_adj").write_text("1000")
    sys.path += part.program.search_path
    return build_announcer(*read_program(part.program), part.module, part.program.run)


def read_program(program: ProgramOfRun) -> tuple[Compiled, Bindings]:
    """Read the compiled program of a run, and its bindings.

    Raises:
        DiagnosticError: the program is damaged.
        OSError: a file cannot be read.
    """
    from colony.execute.colonyc import read

    return read(program.file), read_bindings(Path(program.file))
