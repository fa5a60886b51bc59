"""`colony watch`, as far as the first page."""

from __future__ import annotations

import socket
from contextlib import ExitStack
from pathlib import Path

import click
import pytest

from colony.cli.watch import _recorded, command
from tests.cli.conftest import Colony
from tests.watch.runs import recording


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "give a RECORDING, or --robot NAME"),
        (("run.mcap", "--allow-stop"), "--allow-stop is for a robot that runs"),
        (("run.mcap", "--foxglove"), "--foxglove is for a robot that runs"),
        (("--robot", "rome", "--behavior", "wander"), "--behavior is for a recording"),
    ],
)
def test_misuse(colony: Colony, arguments: tuple[str, ...], message: str) -> None:
    assert message in colony.refusal("watch", *arguments)


def test_what_is_no_recording_is_refused(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"nothing")
    assert "A002" in colony.refusal("watch", "run.mcap")


def test_a_robot_that_does_not_run(colony: Colony, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("COLONY_RUN_DIR", str(tmp_path / "r"))
    assert "rome" in colony.refusal("watch", "--robot", "rome")


def test_a_port_that_is_taken(colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "run.mcap").write_bytes(recording())
    with socket.create_server(("127.0.0.1", 0)) as taken:
        ran = colony("watch", "run.mcap", "--port", str(taken.getsockname()[1]))
    assert ran.code == 2
    assert "cannot listen" in ran.err


def test_a_port_for_foxglove_that_is_taken(colony: Colony) -> None:
    pytest.importorskip("foxglove", reason="needs foxglove-sdk")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert "cannot listen" in colony.one_line("watch", "--robot", "rome", "--foxglove", port)


def test_a_recording_is_that_of_the_robot_of_its_run(
    colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = ("run", "wander", "--map", "loop", "--duration", "0.1", "--no-picture", "--record", "run.mcap")
    for name, description in (("h2=amr", "amr"), ("amr", "amr")):
        assert colony(*run, "--robot", name).code == 0
        with click.Context(command), ExitStack() as resources:
            scene = _recorded("run.mcap", None, None, resources).scene
        assert (scene.robot, scene.description) == (name.partition("=")[0], description)
