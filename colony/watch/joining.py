"""Joining a robot that runs, as a reader: it hears all frames, and sends servers and clients nothing.

The reader asks the leader of the run for the program, and for the memory before a recent frame. It keeps the
frames that it hears until it knows the memory before one of them. From there on it follows the run as if it
had been there from the beginning.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace

import msgspec

from colony.analysis.recording import unpacked_program
from colony.compile.pipeline import compile_program
from colony.execute.compiled import SourceFile
from colony.ir.program import Program
from colony.runs.described import additional_servers, described_robot
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.frames.assembler import frames_to_keep
from colony.runtime.frames.run_frame import Keyframe, RunFrame
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError, ServerNotFoundError
from colony.runtime.kit.listener import hosting_listener
from colony.runtime.library.leader import LEADER, RunProgram, run_keyframe, run_program
from colony.runtime.observe.observer import Observer
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.messages import Effect, Message
from colony.runtime.recordings.json_text import read_keyframe
from colony.runtime.recordings.replay import read_site
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.watch.sources import LiveSource

WATCHER = "colony watch"
"""The name of the connections to a robot that is watched."""

KEYFRAME_INTERVAL_S = 0.2
"""Seconds between two requests for a keyframe, until one is usable."""


def read_program(session: Session) -> RunProgram | None:
    """Return the program of the run that a robot's leader leads; None for a robot without a leader.

    Raises:
        RobotConnectionError: the robot is not there, or its leader refuses.
    """
    try:
        with session.connect(LEADER, name=WATCHER) as leader:
            return leader.do(run_program())
    except ServerNotFoundError:
        if (servers := session.servers()) and LEADER not in servers:
            return None
        raise


@contextmanager
def joined_program(found: RunProgram, robot: str) -> Iterator[Program]:
    """Rebuild the program that a leader gave.

    Raises:
        DiagnosticError: the program has errors.
    """
    sources = (SourceFile(kind=s.kind, path=s.path, data=s.data) for s in found.sources)
    site = read_site(msgspec.json.decode(found.site)) if found.site else None
    with unpacked_program(found.root, sources, site, robot) as program:
        yield program


class Listener:
    """An observer that sends nothing: no fetches, no reports, no requests for a new epoch. Mutable."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self.address = "watch"
        self.listens = observer.listens

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Do nothing."""
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Observe a message."""
        for _ in self._observer.handle(message, now_ns):
            pass
        return ()

    def close(self) -> None:
        """Pass on the frames that wait."""
        self._observer.close()


class Joiner:
    """A sink that holds frames back until the memory before one of them is known. Mutable.

    Args:
        source: what the frames are for.
        keyframe: function that returns the number of a frame and the keyframe before it; may block.
        max_held: maximum number of frames that are held back; beyond it they are shown without memory.
        modules: the modules in Python; memory is not known after a frame without the answer of one.
    """

    def __init__(
        self,
        source: LiveSource,
        keyframe: Callable[[], tuple[int, Keyframe | None]],
        max_held: int,
        modules: Collection[str] = (),
    ) -> None:
        self._source, self._keyframe = source, keyframe
        self._modules = frozenset(modules)
        self._held: deque[RunFrame] = deque()
        self._max_held = max_held
        self._lock = threading.Lock()
        self._is_following = False
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._seek, name="joiner", daemon=True)
        self._thread.start()

    def take(self, log: RunFrame) -> None:
        """Take a frame."""
        self._source.heard_s = time.monotonic()
        with self._lock:
            if log.begins_epoch:
                self._is_following = True
            elif log.skipped:
                self._is_following = False
            self._is_following = self._is_following and self._modules <= log.answers.keys()
            if self._is_following:
                self._source.put(replace(log, memory_unknown=False))
                return
            self._held.append(log)
            if len(self._held) > self._max_held:
                self._put_unknown(self._held.popleft())

    def close(self) -> None:
        """End; nothing more comes. Idempotent."""
        self._ended.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _seek(self) -> None:
        while not self._ended.wait(KEYFRAME_INTERVAL_S):
            if self._held and not self._is_following:
                with suppress(RobotConnectionError):
                    self._resume(*self._keyframe())

    def _put_unknown(self, log: RunFrame) -> None:
        self._source.put(replace(log, memory_unknown=True))

    def _resume(self, k: int, keyframe: Keyframe | None) -> None:
        """Follow from frame `k` on, if it is held and the memory before it is known."""
        with self._lock:
            held = list(self._held)
            place = next((i for i, log in enumerate(held) if log.tick.k == k), None)
            if place is None or keyframe is None or keyframe.memory is None:
                return
            if any(not self._modules <= log.answers.keys() for log in held[place:]):
                return
            for log in held[:place]:
                self._put_unknown(log)
            held[place] = replace(held[place], damaged=True, keyframe=keyframe)
            for log in held[place:]:
                self._source.put(replace(log, memory_unknown=False))
            self._held.clear()
            self._is_following = True


@contextmanager
def listening(
    robot_address: RobotAddress, program: Program, run: str, session: Session, source: LiveSource
) -> Iterator[None]:
    """Listen to a run of a program as long as the context lasts.

    Raises:
        LiveError: the robot cannot be joined.
        DiagnosticError: the program does not fit the robot.
    """

    def keyframe() -> tuple[int, Keyframe | None]:
        with session.connect(LEADER, name=WATCHER) as leader:
            found = leader.do(run_keyframe())
        return found.k, read_keyframe(msgspec.json.decode(found.text)) if found.text else None

    described = described_robot(program.robot)
    servers = (*described.servers, *additional_servers(program.robot, described, robot_address))
    compiled = compile_program(program).compiled
    joiner = Joiner(source, keyframe, frames_to_keep(compiled.frame_ns), compiled.python_modules)
    with ExitStack() as resources:
        resources.callback(joiner.close)
        observer = build_observer(compiled, bind(compiled.robot, servers), (joiner,), run)
        resources.enter_context(observing(robot_address, observer))
        yield


@contextmanager
def observing(robot_address: RobotAddress, observer: Observer) -> Iterator[None]:
    """Let an observer hear a robot, without a message to it, as long as the context lasts.

    Raises:
        LiveError: the robot cannot be joined.
    """
    with hosting_listener(robot_address, Listener(observer)):
        yield
