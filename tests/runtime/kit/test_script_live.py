"""Scripts over live connections, among real servers over zenoh."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from typing import cast

import pytest

from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefusedError, ServerNotFoundError
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.kit.script_live import LiveScripts, RestartedScript, run_script
from colony.runtime.library import data
from tests.waiting import PATIENCE_S, until


def test_a_script_asks_sleeps_and_ends(session: Session) -> None:
    seen: list[object] = []

    def script() -> Script:
        seen.append((yield from do("DServer", data.create_semaphore("$Go", 1))))
        yield from do("DServer", data.set("Answer", [42, 0.5]))
        seen.append((yield from do("DServer", data.get("Answer"))))
        before = yield from sleep(0.0)
        after = yield from sleep(0.02)
        seen.append(after - before >= 20_000_000)

    assert run_script(session, script(), name="asker")
    assert seen == [True, [42, 0.5], True]


def test_its_time_is_that_of_the_servers(session: Session) -> None:
    times: list[int] = []

    def script() -> Script:
        times.append((yield from sleep(0.0)))
        yield from do("DServer", data.set("Answer", 42))
        (dated,) = yield from do("DServer", data.history("Answer"))
        times.append(dated.t_ns)
        times.append((yield from sleep(0.0)))

    assert run_script(session, script(), name="asker")
    assert times == sorted(times)


def test_refusals_are_raised_in_the_script(session: Session) -> None:
    codes: list[str] = []

    def script() -> Script:
        for server, ask in (("DServer", data.get("Nothing")), ("DServer", data.wait("$Nothing"))):
            try:
                yield from do(server, ask)
            except CallRefusedError as refused:
                codes.append(refused.code)
        yield from do("Nobody", data.get("Nothing"))

    with pytest.raises(ServerNotFoundError):
        run_script(session, script(), name="asker", timeout_s=0.2)
    assert codes == ["unknown", "unknown"]


def test_a_script_that_waits_for_ever_can_be_stopped(session: Session) -> None:
    stop, ended = threading.Event(), threading.Event()
    cleaned: list[str] = []

    def script() -> Script:
        try:
            yield from do("DServer", data.create_semaphore("$Never", 0))
            yield from do("DServer", data.wait("$Never"))
        finally:
            cleaned.append("cleaned")

    def run() -> None:
        assert run_script(session, script(), name="waiter", stop=stop) is False
        ended.set()

    thread = threading.Thread(target=run)
    thread.start()
    with session.connect("DServer") as other:
        until(lambda: _waiting(other, "$Never") == 1, "the script waits")
        stop.set()
        until(ended.is_set, "the script ended")
        thread.join()
        assert cleaned == ["cleaned"]
        until(lambda: _waiting(other, "$Never") == 0, "its place in the queue is free")


def test_a_script_is_stopped_that_is_just_opening_a_connection(session: Session) -> None:
    stop, ended = threading.Event(), threading.Event()

    class Slow(Session):
        """Stop is asked for while this opens a connection, and long before it has."""

        def connect(
            self, server: str, *, name: str | None = None, priority: int = 0, timeout_s: float = 10.0
        ) -> Connection:
            stop.set()
            time.sleep(0.3)
            return super().connect(server, name=name, priority=priority, timeout_s=timeout_s)

    def run() -> None:
        assert run_script(Slow(session.hub), wait_for_ever(), name="waiter", stop=stop) is False
        ended.set()

    def wait_for_ever() -> Script:
        yield from do("DServer", data.wait("$Never"))

    with session.connect("DServer") as other:
        other.do(data.create_semaphore("$Never", 0))
        threading.Thread(target=run, daemon=True).start()
        until(ended.is_set, "the script ended")


def _waiting(connection: Connection, name: str) -> int:
    try:
        return len(connection.do(data.semaphore(name)).waiting)
    except CallRefusedError:
        return -1


# --- side by side: all end when the leader does, or when one fails ---------------------------------------


def helper(ended: list[str], begun: list[str] | None = None) -> Script:
    yield from do("DServer", data.create_semaphore("$Go", 0))
    yield from do("DServer", data.signal("$Go"))
    try:
        if begun is not None:
            begun.append("helper")
        while True:
            yield from sleep(0.01)
    finally:
        ended.append("helper")


def leader() -> Script:
    yield from do("DServer", data.create_semaphore("$Go", 0))
    yield from do("DServer", data.wait("$Go"))


def broken() -> Script:
    yield from sleep(0.0)
    raise ValueError("no good")


def waiting() -> Script:
    yield from do("DServer", data.create_semaphore("$Never", 0))
    yield from do("DServer", data.wait("$Never"))


def test_all_end_with_the_leader(session: Session) -> None:
    ended: list[str] = []
    with LiveScripts(session, {"helper": helper(ended), "leader": leader()}, leader="leader") as team:
        assert team.wait(PATIENCE_S)
    assert (team.over, team.done, team.problem, ended) == (True, True, "", ["helper"])


def test_a_helper_that_fails_is_the_end_of_all(session: Session) -> None:
    scripts = {"broken": broken(), "leader": waiting()}
    with LiveScripts(session, scripts, leader="leader") as team:
        assert team.wait(PATIENCE_S)
    assert (team.done, team.problem) == (False, "broken: ValueError: no good")


def test_a_server_that_is_not_there_is_told_in_its_own_words(session: Session) -> None:
    def lost() -> Script:
        yield from do("Nobody", data.get("x"))

    with LiveScripts(session, {"lost": lost()}, leader="lost") as team:
        assert team.wait(PATIENCE_S)
    assert team.problem.startswith("lost: ")
    assert "Nobody" in team.problem
    assert "ServerNotFoundError" not in team.problem
    assert not team.done


def test_ended_from_outside_nothing_is_done_and_nothing_wrong(session: Session) -> None:
    begun: list[str] = []
    ended: list[str] = []
    team = LiveScripts(session, {"helper": helper(ended, begun), "leader": waiting()}, leader="leader")
    with team:
        until(lambda: begun == ["helper"], "the helper has begun")
        assert not team.wait(0.05)
    assert (team.over, team.done, team.problem, ended) == (True, False, "", ["helper"])


def test_a_leader_is_one_of_them(session: Session) -> None:
    with pytest.raises(ValueError, match="`boss` is not among the scripts; expected one of helper"):
        LiveScripts(session, {"helper": helper([])}, leader="boss")


# --- begun again ------------------------------------------------------------------------------------


class Absent:
    """A session with a robot on which no server runs."""

    def connect(self, server: str, **options: object) -> None:
        raise ServerNotFoundError(f"no {server}")

    def time_ns(self) -> int:
        return 7


def test_a_script_begins_again_after_a_failed_call_and_ends_when_it_is_closed() -> None:
    begun, thrice = list[int](), threading.Event()

    def script() -> Script:
        begun.append((yield from sleep(0.0)))
        if len(begun) == 3:
            thrice.set()
            while True:
                yield from sleep(1000.0)
        yield from do("DServer", data.set("X", 1.0))

    with closing(RestartedScript(cast("Session", Absent()), script, name="test")) as running:
        assert thrice.wait(PATIENCE_S)
        running.close()
    assert begun == [7, 7, 7]
    assert not any(thread.name == "test" for thread in threading.enumerate())
