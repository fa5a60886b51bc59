"""`colony watch`, as far as the first page."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.watch.runs import recording


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "give a RECORDING, or --robot NAME"),
        (("run.mcap", "--allow-stop"), "--allow-stop is for a robot that runs"),
        (("--robot", "rome", "--behavior", "wander"), "--behavior is for a recording"),
    ],
)
def test_misuse(colony: Colony, arguments: tuple[str, ...], message: str) -> None:
    ran = colony("watch", *arguments)
    assert ran.code == 2
    assert message in ran.err


def test_what_is_no_recording_is_refused(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"nothing")
    ran = colony("watch", "run.mcap")
    assert ran.code == 2
    assert "A002" in ran.err


def test_a_robot_that_does_not_run(colony: Colony, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("COLONY_RUN_DIR", str(tmp_path / "r"))
    ran = colony("watch", "--robot", "rome")
    assert ran.code == 2
    assert "rome" in ran.err


def test_a_port_that_is_taken(colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import socket

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "run.mcap").write_bytes(recording())
    with socket.create_server(("127.0.0.1", 0)) as taken:
        ran = colony("watch", "run.mcap", "--port", str(taken.getsockname()[1]))
    assert ran.code == 2
    assert "cannot listen" in ran.err
