"""The runs of a robot, watched one after the other."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

from colony.compile.pipeline import compile_program
from colony.files import reason
from colony.ir.memory import ProgramMemory
from colony.ir.program import Program
from colony.ir.servers import ServerSpec
from colony.runs.described import NoDescriptionError, additional_servers, described_robot
from colony.runtime.assembly.limits import limit_bindings, limit_servers
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.frames.run_frame import Keyframe, RunFrame
from colony.runtime.kit.connection import Session
from colony.runtime.kit.discovery import session_with
from colony.runtime.kit.emergency import StopButton
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError, ServerNotFoundError
from colony.runtime.library import clock
from colony.runtime.library.leader import RunProgram
from colony.runtime.observe.observer import Observer, Sink
from colony.runtime.protocol.bindings import Bindings
from colony.runtime.protocol.deployment import LIMITS_RUN
from colony.runtime.protocol.interface import Interface
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.runtime.transport.live.run_directory import LiveError
from colony.text.diagnostics import DiagnosticError, headline
from colony.watch.asking import ANSWER_TIMEOUT_S, Asker, asking_robot, installed_finder
from colony.watch.joining import WATCHER, joined_program, listening, observing, read_program
from colony.watch.scene import PageScene, shown_states
from colony.watch.sources import SILENCE_S, STORE_BYTES, LiveSource, noting_silence
from colony.watch.store import SnapshotStore
from colony.watch.trail import RunTrail
from colony.watch.watched import StopAnswer, Watched

# --- idle ----------------------------------------------------------------------------------------------
#
# Watching a robot that runs no program: its description stands in for the program.
#
# The description by itself is a program without modules. Its limits run on the robot while no program does
# (`runtime.assembly.limits`), so its frames, and who commands its actuators, are heard as those of any run
# are. A robot without limits has frames as well, but no verdicts on the description's actuators: what it is
# sent is not heard.


IDLE_TITLE = "no program runs"
"""The title of the page, in place of the name of a run."""

START_ONE = "start a program with `colony drive FILE`"

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


# --- stopping ------------------------------------------------------------------------------------------
#
# The emergency stop of a page: a button whose connections to the robot are open beforehand.


@contextmanager
def stop_button(session: Session) -> Iterator[Callable[[], StopAnswer]]:
    """Open a button; the context's value presses it, from any thread, and waits for the answers."""
    lock = threading.Lock()
    with StopButton(session, name="colony watch") as button:

        def press() -> StopAnswer:
            with lock:
                return _press(button)

        yield press


def _press(button: StopButton) -> StopAnswer:
    try:
        pressed = button.press()
    except RobotConnectionError as problem:
        return StopAnswer(is_kept=False, text=f"not stopped: {problem}")
    problems = "; ".join(pressed.problems.values())
    if pressed.kept:
        return StopAnswer(is_kept=True, text=f"stopped; acknowledged by {', '.join(pressed.acknowledged)}")
    return StopAnswer(is_kept=False, text=f"stop sent, but: {problems}")


# --- tuning --------------------------------------------------------------------------------------------


def tuner(session: Session) -> Callable[[Mapping[str, float]], str]:
    """Return the function by which a page gives tunable params values."""

    def tune(values: Mapping[str, float]) -> str:
        names, verb = " and ".join(values), "is" if len(values) == 1 else "are"
        try:
            with session.connect(CLOCK, name="colony watch", timeout_s=ANSWER_TIMEOUT_S) as connection:
                return f"{names} {verb} in force from frame {connection.do(clock.tune(values))}"
        except RobotConnectionError as problem:
            return f"{names} {verb} not changed: {problem}"

    return tune


# --- joined run ----------------------------------------------------------------------------------------


LOOK_INTERVAL_S = 1.0
"""Seconds between two looks for the successor of a silent run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinedRun:
    """A run that is watched.

    Attributes:
        identity: the name of the run; what the robot says of itself, if it runs no program.
        watched: what pages show of it.
        source: where its frames come from.
    """

    identity: str | IdleRobot
    watched: Watched
    source: LiveSource


@contextmanager
def joined_run(
    robot: str,
    robot_address: RobotAddress,
    *,
    description: Callable[[Interface], Program],
    scene_for: Callable[[Program, str], PageScene],
    may_stop: bool,
    may_tune: bool,
    tap_for: Callable[[Program, PageScene], Callable[[RunFrame], None]] | None = None,
) -> Iterator[JoinedRun]:
    """Watch the run of a robot, or the robot alone if it runs no program, as long as the context lasts.

    Args:
        robot: its name.
        robot_address: where it is.
        description: returns the description that a robot with this interface is served with; see
            `served_program`.
        scene_for: returns the scene of a program, with a title.
        may_stop: True if pages may stop the robot.
        may_tune: True if pages may change tunable params.
        tap_for: returns what also takes each frame of a program.

    Raises:
        LiveError, RobotConnectionError: the robot cannot be joined, or runs no program and its description is
            not known.
        DiagnosticError: the program, or the description, has errors, or does not fit the robot.
    """
    with ExitStack() as resources:
        session = resources.enter_context(session_with(robot_address))
        found = _found(session)
        if isinstance(found, IdleRobot):
            program = _without_program(found, description)
            scene = replace(scene_for(program, IDLE_TITLE), is_idle=True)
        else:
            program = resources.enter_context(joined_program(found, robot))
            scene = scene_for(program, f"run {found.run}")
        store, trail = SnapshotStore(scene.modules, max_bytes=STORE_BYTES), RunTrail(program)
        resources.callback(store.close)
        taps = () if tap_for is None else (tap_for(program, scene),)
        source = LiveSource(program, store, trail, *taps)
        resources.callback(source.close)
        listened = (
            listening_idle(robot_address, program, found, source)
            if isinstance(found, IdleRobot)
            else listening(robot_address, program, found.run, session, source)
        )
        resources.enter_context(listened)
        change = "a program starts" if scene.is_idle else "its run has ended"
        silence = f"no frames come from {robot}: {change}, or the robot is silent"
        resources.enter_context(noting_silence(source, store, silence))
        stop = resources.enter_context(stop_button(session)) if may_stop else None
        find = installed_finder()
        asker = Asker(lambda: asking_robot(session, find))
        resources.callback(asker.close)
        watched = Watched(
            scene=scene,
            store=store,
            is_live=True,
            explain=trail.explain,
            stop=stop,
            tune=tuner(session) if may_tune else None,
            asker=asker,
        )
        yield JoinedRun(identity=_identity(found), watched=watched, source=source)


def _found(session: Session) -> RunProgram | IdleRobot:
    return read_program(session) or idle_robot(session)


def _without_program(idle: IdleRobot, description: Callable[[Interface], Program]) -> Program:
    """Return the description of a robot without a program, which stands in for one."""
    try:
        return description(idle.interface)
    except NoDescriptionError as problem:
        give = f"give the description with `--robot NAME=DESCRIPTION`, or {START_ONE}"
        raise NoDescriptionError(f"the robot runs no program, and {problem}: {give}") from None


def _identity(found: RunProgram | IdleRobot) -> str | IdleRobot:
    return found if isinstance(found, IdleRobot) else found.run


class Succession:
    """The runs of a robot, watched one after the other, and the robot alone between them. Mutable.

    Args:
        robot_address: where the robot is.
        join: joins the current run, as `joined_run` does.

    Raises:
        LiveError, RobotConnectionError, DiagnosticError: as by `joined_run`.
    """

    def __init__(
        self, robot_address: RobotAddress, join: Callable[[], AbstractContextManager[JoinedRun]]
    ) -> None:
        self._robot_address, self._join = robot_address, join
        self._resources = ExitStack()
        self._joined = self._resources.enter_context(join())
        self._refused: str | IdleRobot | None = None
        self._lacking = ""
        self._said: str | None = None
        self._may_differ = False
        self._due_s = 0.0

    @property
    def watched(self) -> Watched:
        """What pages show of the run."""
        return self._joined.watched

    def follow(self, show: Callable[[Watched], None]) -> None:
        """Where another run has followed, show that and end the one before; may block.

        The robot is asked while it is silent, and once when frames come again: it may run something else. The
        page says why a run cannot be shown.

        Raises:
            DiagnosticError: the program of the new run, or the robot's description, has errors; said once.
            NoDescriptionError: no program runs now, and the robot's description is not known; said once.
            OSError: this machine lacks what the new run needs, such as room on its disk; said once, and tried
                again.
        """
        now = time.monotonic()
        is_silent = now - self._joined.source.heard_s >= SILENCE_S
        self._may_differ |= is_silent
        if now < self._due_s or not self._may_differ:
            return
        try:
            self._look(show, is_silent=is_silent)
            self._lacking = ""
        except (DiagnosticError, NoDescriptionError) as problem:
            self._say(
                headline(problem.diagnostics[0]) if isinstance(problem, DiagnosticError) else str(problem)
            )
            raise
        except CallRefusedError as problem:  # by the leader of a run without source files
            self._say(str(problem))
        except (LiveError, RobotConnectionError):  # the robot is silent, or not there
            self._lacking = ""
        except OSError as problem:
            before, self._lacking = self._lacking, reason(problem)
            self._say(self._lacking)
            if self._lacking != before:
                raise
        finally:
            self._due_s = time.monotonic() + LOOK_INTERVAL_S

    def _say(self, why: str) -> None:
        """Let the page say why the next run cannot be shown."""
        self.watched.store.problem = self._said = f"the next run cannot be shown: {why}"

    def _look(self, show: Callable[[Watched], None], *, is_silent: bool) -> None:
        with session_with(self._robot_address) as session:
            identity = _identity(_found(session))
        self._may_differ = is_silent
        if identity == self._joined.identity and self.watched.store.problem == self._said:
            self.watched.store.problem = self._said = None
        if identity not in (self._joined.identity, self._refused):
            self._replace(identity, show)

    def _replace(self, identity: str | IdleRobot, show: Callable[[Watched], None]) -> None:
        with ExitStack() as resources:
            try:
                joined = resources.enter_context(self._join())
            except (DiagnosticError, NoDescriptionError):
                self._refused = identity
                raise
            show(joined.watched)
            before, self._resources = self._resources, resources.pop_all()
            self._joined = joined
            before.close()

    def close(self) -> None:
        """End watching. Idempotent."""
        self._resources.close()

    def __enter__(self) -> Succession:
        """Return the runs."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End watching."""
        self.close()
