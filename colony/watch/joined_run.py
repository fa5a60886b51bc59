"""The runs of a robot, watched one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass

from colony.files import reason
from colony.ir.program import Program
from colony.robots.discovery import session_with
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.transport.live.errors import LiveError
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.text.diagnostics import DiagnosticError
from colony.watch.asking import Asker, asking_robot
from colony.watch.joining import Joiner, joined_program, listening, read_program
from colony.watch.live import STORE_BYTES, LiveSource
from colony.watch.pictures import installed_finder
from colony.watch.scene import Scene
from colony.watch.silence import SILENCE_S, noting_silence
from colony.watch.stopping import stop_button
from colony.watch.store import SnapshotStore
from colony.watch.trail import Trail
from colony.watch.watched import Watched

LOOK_INTERVAL_S = 1.0
"""Seconds between two looks for the successor of a silent run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinedRun:
    """A run that is watched: its name, what pages show of it, and the sink of its frames."""

    run: str
    watched: Watched
    sink: Joiner


@contextmanager
def joined_run(
    robot: str,
    robot_address: RobotAddress,
    *,
    scene_for: Callable[[Program, str], Scene],
    may_stop: bool,
) -> Iterator[JoinedRun]:
    """Watch the run of a robot as long as the context lasts.

    Args:
        robot: its name.
        robot_address: where it is.
        scene_for: returns the scene of a program, with a title.
        may_stop: True if pages may stop the robot.

    Raises:
        LiveError, RobotConnectionError: the robot cannot be joined, or runs no program.
        DiagnosticError: the program has errors, or does not fit the robot.
    """
    with ExitStack() as resources:
        session = resources.enter_context(session_with(robot_address))
        found = read_program(session)
        program = resources.enter_context(joined_program(found, robot))
        scene = scene_for(program, f"run {found.run}")
        store, trail = SnapshotStore(scene.modules, max_bytes=STORE_BYTES), Trail(program)
        resources.callback(store.close)
        source = LiveSource(program, store, trail)
        resources.callback(source.close)
        sink = resources.enter_context(listening(robot_address, program, found.run, session, source))
        resources.enter_context(noting_silence(sink, store, robot))
        stop = resources.enter_context(stop_button(session)) if may_stop else None
        find = installed_finder()
        asker = Asker(lambda: asking_robot(session, find))
        resources.callback(asker.close)
        watched = Watched(
            scene=scene, store=store, is_live=True, explain=trail.explain, stop=stop, asker=asker
        )
        yield JoinedRun(run=found.run, watched=watched, sink=sink)


class Succession:
    """The runs of a robot, watched one after the other. Mutable.

    Args:
        robot_address: where the robot is.
        join: joins the run of now, as `joined_run` does.

    Raises:
        LiveError, RobotConnectionError: the robot cannot be joined, or runs no program.
        DiagnosticError: the program has errors, or does not fit the robot.
    """

    def __init__(
        self, robot_address: RobotAddress, join: Callable[[], AbstractContextManager[JoinedRun]]
    ) -> None:
        self._robot_address, self._join = robot_address, join
        self._resources = ExitStack()
        self._joined = self._resources.enter_context(join())
        self._refused = ""
        self._lacking = ""
        self._due_s = 0.0

    @property
    def watched(self) -> Watched:
        """What pages show of the run."""
        return self._joined.watched

    def follow(self, show: Callable[[Watched], None]) -> None:
        """Where another run has followed, show that and end the one before; may block.

        While frames come the robot is not asked.

        Raises:
            DiagnosticError: the program of the new run has errors; said once.
            OSError: this machine lacks what the new run needs, such as room on its disk; said once, and tried
                again.
        """
        now = time.monotonic()
        if now < self._due_s or now - self._joined.sink.heard_s < SILENCE_S:
            return
        try:
            with suppress(LiveError, RobotConnectionError):
                run = self._run()
                if run not in (self._joined.run, self._refused):
                    self._replace(run, show)
            self._lacking = ""
        except OSError as problem:
            before, self._lacking = self._lacking, reason(problem)
            if self._lacking != before:
                raise
        finally:
            self._due_s = time.monotonic() + LOOK_INTERVAL_S

    def _run(self) -> str:
        with session_with(self._robot_address) as session:
            return read_program(session).run

    def _replace(self, run: str, show: Callable[[Watched], None]) -> None:
        with ExitStack() as resources:
            try:
                joined = resources.enter_context(self._join())
            except DiagnosticError:
                self._refused = run
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
