"""Watching a robot that runs no program: its description stands in for the program.

The description by itself is a program without modules. Its limits run on the robot while no program does
(`runtime.assembly.limits`), so its frames, and who commands its actuators, are heard as those of any run are.
A robot without limits has frames as well, but no verdicts on the description's actuators: what it is sent is
not heard.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

from colony.compile.pipeline import compile_program
from colony.ir.memory import ProgramMemory
from colony.ir.program import Program
from colony.ir.servers import ServerSpec
from colony.robots.bound_servers import additional_servers
from colony.robots.described import described_robot
from colony.runtime.assembly.limits import limit_bindings, limit_servers
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.frames.run_frame import Keyframe, RunFrame
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import ServerNotFoundError
from colony.runtime.library import clock
from colony.runtime.observe.observer import Observer, Sink
from colony.runtime.protocol.bindings import Bindings
from colony.runtime.protocol.deployment import LIMITS_RUN
from colony.runtime.protocol.interface import Interface
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.watch.joining import WATCHER, observing
from colony.watch.scene import shown_states
from colony.watch.sources import LiveSource

IDLE_TITLE = "no program runs"
"""The title of the page, in place of the name of a run."""

START_ONE = "start a program with `colony run FILE --connect`"

_NO_MEMORY = Keyframe(ProgramMemory(first_ns=None, cells={}))


class IdleRobot(NamedTuple):
    """A robot that runs no program.

    Attributes:
        run: the run of its frames: that of its limits, or "".
        interface: that of the description that it is served with; without parts if it has none.
        servers: the servers that its Clock watches.
    """

    run: str
    interface: Interface
    servers: frozenset[str]


def idle_robot(session: Session) -> IdleRobot:
    """Return what a robot without a leader says of itself.

    Raises:
        RobotConnectionError: its Clock does not answer, or a program runs whose leader is not there.
    """
    with session.connect(CLOCK, name=WATCHER) as connection:
        found = connection.do(clock.participants())
        interface = connection.do(clock.interface())
    if found.run not in ("", LIMITS_RUN):
        raise ServerNotFoundError("the program that the robot runs has lost its leader: try again")
    return IdleRobot(found.run, interface, frozenset(s.server for s in found.servers))


class IdleSink:
    """A sink of the frames of a robot without a program, for a source.

    No process gives the memory before a frame, so that of a description is known from the first frame of an
    epoch on. A description without memory has nothing unknown.

    Args:
        source: what the frames are for.
        program: the description.
    """

    def __init__(self, source: LiveSource, program: Program) -> None:
        self._source = source
        self._has_memory = bool(shown_states(program) or compile_program(program).compiled.code.memory_cells)

    def take(self, log: RunFrame) -> None:
        """Take a frame."""
        known = log if self._has_memory else replace(log, memory_unknown=False, keyframe=_NO_MEMORY)
        self._source.take(known)

    def close(self) -> None:
        """Do nothing."""


@contextmanager
def listening_idle(
    robot_address: RobotAddress, program: Program, idle: IdleRobot, source: LiveSource
) -> Iterator[None]:
    """Listen to a robot without a program as long as the context lasts.

    Raises:
        LiveError: the robot cannot be joined.
        DiagnosticError: the description does not fit the robot.
    """
    robot, described = program.robot, described_robot(program.robot)
    servers = (*described.servers, *additional_servers(robot, described, robot_address))
    observer = idle_observer(program, idle, servers, IdleSink(source, program))
    with observing(robot_address, observer):
        yield


def idle_observer(program: Program, idle: IdleRobot, servers: tuple[ServerSpec, ...], sink: Sink) -> Observer:
    """Return an observer of a robot that runs no program.

    Args:
        program: its description.
        idle: the robot.
        servers: what its servers offer; others are assumed to be as the description says.
        sink: what the frames are for.

    Raises:
        DiagnosticError: the description does not fit the servers.
    """
    compiled = compile_program(program).compiled
    bindings = limit_bindings(program.robot, servers)
    decided: Collection[str] = ()
    if idle.run == LIMITS_RUN:
        limited = limit_servers(compiled)
        decided = [b.actuator for b in bindings.actuators if b.server in limited]
    else:  # the Clock does not say of other servers that they are down
        sensors = tuple(b for b in bindings.sensors if b.server in idle.servers)
        bindings = Bindings(sensors=sensors, actuators=bindings.actuators)
    return build_observer(compiled, bindings, (sink,), idle.run, decided=decided)
