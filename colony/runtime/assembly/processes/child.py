"""A process of a robot: `python -m colony.runtime.assembly.processes.child SPEC`.

It runs until it gets a signal or its parent ends, and then closes its resources; a base server stops the
base. It reports errors on standard error and in its exit code. Hardware servers have their own entry point
next to their drivers, which passes the drivers to `main`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import NoReturn

from colony.collector import gc_frozen
from colony.files import describe
from colony.runtime.assembly.processes.hosting import HostedParts, leading
from colony.runtime.assembly.processes.shutdown import (
    EXIT_FAILED,
    EXIT_FINAL,
    Shutdown,
    exit_if_out_of_resources,
    exit_with,
    log_line,
    make_printing_safe,
    on_parent_exit,
    on_signals,
    reporting_stalls,
)
from colony.runtime.assembly.processes.spec import (
    AnnouncerPart,
    ClientsPart,
    DriverError,
    DriverFactory,
    GatewayPart,
    GroupPart,
    Part,
    Spec,
    address_of,
    read_spec,
    singles,
)
from colony.runtime.store.store import StoreError
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import Local, RobotAddress
from colony.runtime.transport.live.run_directory import GatewayFullError, LiveError
from colony.text.diagnostics import DiagnosticError


class StartupError(Exception):
    """A process cannot start because an input is missing or invalid; the message says which and why."""


def run(
    spec: Spec,
    shutdown: Shutdown,
    *,
    devices: DriverFactory | None = None,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Run the part that the spec describes until the shutdown.

    `ready` is called once the process has joined the others.

    Raises:
        LiveError: it cannot join the robot's processes; for example, another process serves its name.
        StartupError: an input is missing or invalid.
        DriverError: the driver of a real device cannot be imported or made.
        StoreError: it cannot store data that it must store, and has to end.
        Exception: as raised by a node.
    """
    robot_address = address_of(spec.robot_address)
    try:
        with ExitStack() as resources:
            host = resources.enter_context(_host(spec.part, robot_address, devices, resources))
            shutdown.on_request(host.stop)
            if not isinstance(spec.part, GatewayPart):
                resources.enter_context(leading(host, singles(spec.part), log_line))
            if isinstance(spec.part, GroupPart):
                resources.enter_context(reporting_stalls(log_line))
            ready()
            with gc_frozen():
                host.run()
    except GatewayFullError as full:
        if shutdown.reason is None:
            log_line(f"{full}; it restarts, and its users are logged in again automatically")
            restart_in_place()


def restart_in_place() -> NoReturn:
    """Replace this process by a new run of the same command, with the same process id."""
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


def _host(
    part: Part, robot_address: RobotAddress, devices: DriverFactory | None, resources: ExitStack
) -> Host:
    if isinstance(part, GatewayPart):
        from colony.runtime.transport.live.gateway import open_gateway
        from colony.runtime.transport.live.security import read_security

        if not isinstance(robot_address, Local):
            raise ValueError("a gateway runs on the robot's own machine")
        return open_gateway(robot_address, part.listen, read_security(Path(part.security)), report=log_line)
    hosted = resources.enter_context(closing(HostedParts(robot_address, devices, log_line)))
    try:
        nodes = hosted.build(singles(part))
    except OSError as problem:
        raise StartupError(describe(problem)) from None
    except (DiagnosticError, StoreError) as problem:
        raise StartupError(str(problem)) from None
    return Host.open(
        robot_address,
        nodes,
        serves=not isinstance(part, (ClientsPart, AnnouncerPart)),
        report=log_line,
        on_failure=hosted.replacement if isinstance(part, GroupPart) else None,
    )


def main(devices: DriverFactory | None = None) -> None:
    """Run a process that a supervisor started."""
    make_printing_safe()
    shutdown = Shutdown()
    with on_signals(shutdown):
        on_parent_exit(shutdown)
        try:
            run(read_spec(Path(sys.argv[1])), shutdown, devices=devices)
        except (LiveError, StartupError) as problem:
            exit_with(str(problem))
        except DriverError as problem:
            exit_with(str(problem), EXIT_FINAL if problem.is_final else EXIT_FAILED)
        except StoreError as problem:
            exit_with(str(problem), EXIT_FAILED)
        except Exception as problem:
            exit_if_out_of_resources(problem)
    shutdown.end_forked()


if __name__ == "__main__":
    main()
