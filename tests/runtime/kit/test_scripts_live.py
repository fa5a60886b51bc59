"""Scripts side by side over live connections: all end when the leader does, or when one fails."""

from __future__ import annotations

import pytest

from colony.runtime.kit.connection import Session
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.kit.scripts_live import LiveScripts
from colony.runtime.library import data
from tests.waiting import PATIENCE_S, until


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
