"""A run that is watched while it goes on: joining it, falling behind, and looking at it when it is silent."""

from __future__ import annotations

import errno
import json
import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from colony.ir.memory import ProgramMemory
from colony.runs.described import NoDescriptionError
from colony.runtime.frames.run_frame import Keyframe, RunFrame
from colony.runtime.kit.errors import ServerNotFoundError
from colony.runtime.library.leader import RunProgram, SourceText
from colony.runtime.protocol.interface import Interface
from colony.text.diagnostics import DiagnosticError
from colony.watch import joined_run, sources
from colony.watch.joined_run import IdleRobot
from colony.watch.joining import Joiner, joined_program, read_program
from colony.watch.serving import user_token
from colony.watch.snapshot import PageFrame
from colony.watch.sources import LiveSource, noting_silence
from colony.watch.store import SnapshotStore
from colony.watch.trail import RunTrail
from colony.watch.watched import Watched
from tests.waiting import until
from tests.watch.runs import FRAMES, PROGRAM, TEXT, page, run, scene, served, snapshots


@pytest.fixture
def store() -> Iterator[SnapshotStore]:
    with closing(SnapshotStore(scene().modules)) as made:
        yield made


@pytest.fixture
def source(store: SnapshotStore) -> LiveSource:
    return LiveSource(PROGRAM, store, RunTrail(PROGRAM))


@pytest.fixture
def watched(store: SnapshotStore) -> Watched:
    return Watched(scene=scene(), store=store, is_live=True)


def known(store: SnapshotStore) -> list[bool]:
    return [b'"is_known":true' in store.read(i) for i in range(store.span.end)]


def test_it_shows_what_a_recording_shows(store: SnapshotStore, source: LiveSource) -> None:
    for log in run():
        source.take(log)
    source.close()
    assert store.is_complete
    assert store.span.end == FRAMES
    assert store.read(12) == store._encode(snapshots()[12])


class GatedStore(SnapshotStore):
    """A store that takes nothing until its gate is open."""

    def __init__(self) -> None:
        super().__init__(scene().modules)
        self.gate = threading.Event()

    def add(self, snapshot: PageFrame) -> None:
        self.gate.wait()
        super().add(snapshot)


def test_a_watcher_that_falls_behind_drops_frames_and_recovers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "MAX_WAITING", 10)
    store = GatedStore()
    source = LiveSource(PROGRAM, store, RunTrail(PROGRAM))
    first, *others = run()
    source.take(first)
    until(lambda: not source._waiting, "its thread has the first frame")
    for log in others:
        source.take(log)
    store.gate.set()
    source.close()
    assert [b'"k":%d,' % k in store.read(i) for i, k in enumerate((0, *range(10, FRAMES)))] == [True] * 11
    assert known(store)[:2] == [True, False]
    assert known(store)[-1]
    store.close()


def observed(k: int, log: RunFrame) -> RunFrame:
    """Return a frame as an observer that joined late has it: without memory, and without keyframes of use."""
    tick = type(log.tick)(k=log.tick.k, t_ns=log.tick.t_ns, start=0)
    return replace(log, tick=tick, memory_unknown=True, keyframe=Keyframe(None) if k % 4 == 0 else None)


def test_a_reader_that_joins_goes_on_from_the_memory_that_the_leader_gives(
    store: SnapshotStore, source: LiveSource
) -> None:
    frames = run()
    keys = {log.tick.k: log.keyframe for log in frames if log.keyframe is not None}
    key = max(k for k in keys if k < 12)
    joiner = Joiner(source, lambda: (key, keys[key]), FRAMES)
    for k, log in enumerate(frames[5:12], 5):
        joiner.take(observed(k, log))
    until(lambda: store.span.end == 7, "the frames that were held back are shown")
    for k, log in enumerate(frames[12:], 12):
        joiner.take(observed(k, log))
    joiner.close()
    source.close()
    assert known(store) == [k >= key for k in range(5, FRAMES)]
    assert store.read(FRAMES - 6) == store._encode(snapshots()[FRAMES - 1])


def test_a_reader_that_missed_frames_forgets_what_it_remembered(
    store: SnapshotStore, source: LiveSource
) -> None:
    frames = run()
    memory = ProgramMemory(first_ns=0, cells={"window careful.0 until": 1_000_000_000})
    joiner = Joiner(source, lambda: (8, Keyframe(memory)), FRAMES)
    for log in frames[:5]:
        joiner.take(log)
    joiner.take(replace(frames[8], skipped=3, memory_unknown=True, keyframe=None))
    until(lambda: store.span.end == 6, "the frame that was held back is shown")
    joiner.close()
    source.close()
    [remaining_s] = json.loads(store.read(5))["windows"].values()
    assert remaining_s == pytest.approx(0.2), "of the memory that was given: until 1 s, not until 0.9 s"


def test_without_a_leader_frames_are_shown_without_memory(store: SnapshotStore, source: LiveSource) -> None:
    joiner = Joiner(source, lambda: (-1, None), 4)
    for k, log in enumerate(run()[5:15], 5):
        joiner.take(observed(k, log))
    joiner.close()
    source.close()
    assert known(store) == [False] * 6


def test_a_page_that_does_not_read_keeps_no_other_page_waiting(source: LiveSource, watched: Watched) -> None:
    with ExitStack() as resources:
        server = resources.enter_context(served(watched))
        resources.enter_context(page(server.host))  # its messages wait unread
        opened = resources.enter_context(page(server.host))
        for log in run():
            source.take(log)
        opened.shown(FRAMES - 1)  # another page gets what the frozen one does not read
    source.close()


def look_without_a_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a succession look at each call, by what the test puts in place of a session."""
    monkeypatch.setattr(joined_run, "LOOK_INTERVAL_S", 0)
    monkeypatch.setattr(joined_run, "session_with", lambda address: nullcontext())


def test_a_run_for_which_there_is_no_room_is_tried_again_and_said_once(
    store: SnapshotStore, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    look_without_a_robot(monkeypatch)
    monkeypatch.setattr(joined_run, "read_program", lambda session: SimpleNamespace(run="2"))
    sink: Any = SimpleNamespace(heard_s=-math.inf)
    address: Any = None
    runs = {name: joined_run.JoinedRun(identity=name, watched=watched, source=sink) for name in "12"}
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    joins: Iterator[joined_run.JoinedRun | OSError] = iter((runs["1"], full, full, runs["2"]))

    @contextmanager
    def join() -> Iterator[joined_run.JoinedRun]:
        joined = next(joins)
        if isinstance(joined, OSError):
            raise joined
        yield joined

    shown: list[Watched] = []
    with joined_run.Succession(address, join) as succession:
        with pytest.raises(OSError, match="No space left"):
            succession.follow(shown.append)
        succession.follow(shown.append)
        assert not shown
        assert store.problem == "the next run cannot be shown: No space left on device"
        succession.follow(shown.append)
        succession.follow(shown.append)
        assert shown == [watched]


def test_where_nothing_is_known_of_a_robot_without_a_program_it_is_said_once_and_its_last_run_stays(
    store: SnapshotStore, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    look_without_a_robot(monkeypatch)
    alone = IdleRobot("", Interface(), frozenset())
    monkeypatch.setattr(joined_run, "read_program", lambda session: None)
    monkeypatch.setattr(joined_run, "idle_robot", lambda session: alone)
    sink: Any = SimpleNamespace(heard_s=-math.inf)
    address: Any = None
    joined: list[str] = []

    @contextmanager
    def join() -> Iterator[joined_run.JoinedRun]:
        joined.append("")
        if len(joined) > 1:
            raise NoDescriptionError("its description is not found")
        yield joined_run.JoinedRun(identity="1", watched=watched, source=sink)

    shown: list[Watched] = []
    with joined_run.Succession(address, join) as succession:
        with pytest.raises(NoDescriptionError, match="its description is not found"):
            succession.follow(shown.append)
        for _ in range(2):
            succession.follow(shown.append)
    assert not shown
    assert len(joined) == 2, "it is not tried again"
    assert store.problem == "the next run cannot be shown: its description is not found"


def test_after_a_silence_the_robot_is_asked_what_it_is_although_frames_come(
    store: SnapshotStore, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    look_without_a_robot(monkeypatch)
    monkeypatch.setattr(joined_run, "read_program", lambda session: None)
    answers: list[IdleRobot] = []

    def idle_robot(session: object) -> IdleRobot:
        if not answers:
            raise ServerNotFoundError("rome has no Clock")
        return answers.pop()

    monkeypatch.setattr(joined_run, "idle_robot", idle_robot)
    one, other = (IdleRobot("limits", Interface(robot=name), frozenset()) for name in ("one", "other"))
    sinks: list[Any] = [SimpleNamespace(heard_s=math.inf) for _ in range(2)]
    address: Any = None
    joins = iter(zip((one, other), sinks, strict=True))

    @contextmanager
    def join() -> Iterator[joined_run.JoinedRun]:
        run, sink = next(joins)
        yield joined_run.JoinedRun(identity=run, watched=watched, source=sink)

    shown: list[Watched] = []
    with joined_run.Succession(address, join) as succession:
        answers.append(other)
        succession.follow(shown.append)
        assert answers, "while frames come it is not asked"
        answers.clear()
        sinks[0].heard_s = -math.inf
        succession.follow(shown.append)
        sinks[0].heard_s = math.inf
        answers += [other, other]
        succession.follow(shown.append)
        succession.follow(shown.append)
    assert shown == [watched]
    assert len(answers) == 1, "once"


@pytest.mark.parametrize("path", ["{outside}", "../{name}", "a/../../{name}", ""])
def test_a_leader_gives_no_file_outside_the_program(path: str, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    given = path.format(outside=outside, name=outside.name)
    sources = (
        SourceText(kind="behavior", path="b.colony", data=TEXT.encode()),
        SourceText(kind="behavior", path=given, data=b"given"),
    )
    found = RunProgram(run="1", root="b.colony", sources=sources)
    with pytest.raises(DiagnosticError, match="outside it"), joined_program(found, "tiny"):
        pass
    assert not outside.exists()


def test_silence_is_said_and_taken_back(store: SnapshotStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("colony.watch.sources.SILENCE_S", 0.05)
    monkeypatch.setattr("colony.watch.sources.CHECK_INTERVAL_S", 0.01)
    sink = SimpleNamespace(heard_s=time.monotonic() - 1)
    with noting_silence(sink, store, "no frames come from rome"):
        until(lambda: store.problem == "no frames come from rome", "it is said")
        sink.heard_s = time.monotonic() + 1000
        until(lambda: store.problem is None, "it is taken back")


def test_the_token_stays_and_only_its_user_can_read_it(tmp_path: Path) -> None:
    environment = {"XDG_CACHE_HOME": str(tmp_path)}
    token = user_token(environment)
    assert user_token(environment) == token
    [file] = tmp_path.rglob("*token")
    assert file.stat().st_mode & 0o777 == 0o600
    file.chmod(0o644)
    assert user_token(environment) != token
    file.write_text("short")
    assert len(user_token(environment)) >= 32
    assert user_token({}) != user_token({})


def test_a_robot_without_a_leader_runs_no_program() -> None:
    def connect(server: str, **_: object) -> object:
        raise ServerNotFoundError(f"rome has no {server}: found Clock, RServer")

    session = SimpleNamespace(connect=connect, servers=lambda: ("Clock", "RServer"))
    assert read_program(session) is None  # type: ignore[arg-type]
    session.servers = tuple
    with pytest.raises(ServerNotFoundError, match="has no Leader"):
        read_program(session)  # type: ignore[arg-type]
