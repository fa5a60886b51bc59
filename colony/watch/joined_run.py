"""The runs of a robot, watched one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace

from colony.files import reason
from colony.ir.program import Program
from colony.robots.description import NoDescriptionError
from colony.robots.discovery import session_with
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError
from colony.runtime.library.leader import RunProgram
from colony.runtime.protocol.interface import Interface
from colony.runtime.transport.live.errors import LiveError
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.text.diagnostics import DiagnosticError, headline
from colony.watch.asking import Asker, asking_robot
from colony.watch.idle import IDLE_TITLE, START_ONE, IdleRobot, idle_robot, listening_idle
from colony.watch.joining import joined_program, listening, read_program
from colony.watch.pictures import installed_finder
from colony.watch.scene import Scene
from colony.watch.sources import SILENCE_S, STORE_BYTES, LiveSource, noting_silence
from colony.watch.stopping import stop_button
from colony.watch.store import SnapshotStore
from colony.watch.trail import Trail
from colony.watch.watched import Watched

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
    scene_for: Callable[[Program, str], Scene],
    may_stop: bool,
) -> Iterator[JoinedRun]:
    """Watch the run of a robot, or the robot alone if it runs no program, as long as the context lasts.

    Args:
        robot: its name.
        robot_address: where it is.
        description: returns the description that a robot with this interface is served with; see
            `served_program`.
        scene_for: returns the scene of a program, with a title.
        may_stop: True if pages may stop the robot.

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
        store, trail = SnapshotStore(scene.modules, max_bytes=STORE_BYTES), Trail(program)
        resources.callback(store.close)
        source = LiveSource(program, store, trail)
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
            scene=scene, store=store, is_live=True, explain=trail.explain, stop=stop, asker=asker
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
