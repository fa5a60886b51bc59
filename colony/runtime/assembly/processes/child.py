"""A process of a robot: `python -m colony.runtime.assembly.processes.child SPEC`.

It runs until it is told to end by a signal, or its parent is gone, and then closes what it holds: a server
of a base stops it. What is wrong with it is said on standard error, and told by the exit code. Servers of
hardware have an entry of their own beside their drivers, which gives these to `main`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

from colony.collector import collector_past_startup
from colony.os_errors import described
from colony.runtime.assembly.processes.devices import Devices
from colony.runtime.assembly.processes.ending import (
    EXIT_FAILED,
    Ending,
    drop_what_cannot_be_printed,
    give_up,
    give_up_without,
    on_death_of_parent,
    on_signals,
    say,
)
from colony.runtime.assembly.processes.parts import is_nonblocking, nodes_of, serves
from colony.runtime.assembly.processes.spec import GatewayPart, Part, Spec, place_of, read_spec
from colony.runtime.store.store import StoreError
from colony.runtime.transport.live.errors import GatewayFull, LiveError
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.place import Local, Place
from colony.text.diagnostics import Failure


class CannotBegin(Exception):
    """What a process needs to begin is not there, or is no good; the message tells what and why."""


def run(
    spec: Spec,
    ending: Ending,
    *,
    devices: Devices | None = None,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Be what the spec says until it is time to end; `ready` is told when it has joined the others.

    Raises:
        LiveError: it cannot join the robot's processes; another process serves its name, for one.
        CannotBegin: what it needs is not there, or is no good.
        StoreError: it cannot keep what it has to, and must not go on.
        Exception: whatever a node raised.
    """
    place = place_of(spec.place)
    try:
        with ExitStack() as holds:
            host = holds.enter_context(_host(spec.part, place, devices, holds))
            ending.then(host.stop)
            ready()
            with collector_past_startup():
                host.run()
    except GatewayFull as full:
        if ending.why is None:
            say(f"{full}; it begins again, and its users log in once more by themselves")
            begin_again()


def begin_again() -> NoReturn:
    """Replace this process by a new run of the same command, under the same process id."""
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


def _host(part: Part, place: Place, devices: Devices | None, holds: ExitStack) -> Host:
    if isinstance(part, GatewayPart):
        from colony.runtime.transport.live.gateway import open_gateway
        from colony.runtime.transport.live.security import read_security

        if not isinstance(place, Local):
            raise ValueError("a gateway runs on the robot's own machine")
        return open_gateway(place, part.listen, read_security(Path(part.security)), report=say)
    try:
        nodes = nodes_of(part, place, devices, holds)
    except OSError as problem:
        raise CannotBegin(described(problem)) from None
    except (Failure, StoreError) as problem:
        raise CannotBegin(str(problem)) from None
    return Host.open(place, nodes, serves=serves(part), direct=is_nonblocking(part), report=say)


def main(devices: Devices | None = None) -> None:
    """The entry of a process that a supervisor starts."""
    drop_what_cannot_be_printed()
    ending = Ending()
    with on_signals(ending):
        on_death_of_parent(ending)
        try:
            run(read_spec(Path(sys.argv[1])), ending, devices=devices)
        except (LiveError, CannotBegin) as problem:
            give_up(str(problem))
        except StoreError as problem:
            give_up(str(problem), EXIT_FAILED)
        except Exception as problem:
            give_up_without(problem)
    ending.end_forked()


if __name__ == "__main__":
    main()
