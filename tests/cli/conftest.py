"""Commands are run in this process, as the console script runs them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from colony.cli.main import main
from tests.body.test_disagreements import BODY, INTERFACE
from tests.cli.machine import Machine
from tests.commands import Command

Colony = Command


@pytest.fixture
def colony(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Colony:
    """Run `colony ARGUMENTS` in an empty directory."""
    monkeypatch.chdir(tmp_path)
    return Command(main, monkeypatch, capsys)


def server_states(colony: Colony) -> dict[str, str]:
    """Return the states of the servers of the only robot, as `colony ps` shows them."""
    (found,) = json.loads(colony.output("ps", "--format", "json"))
    return {server["server"]: server["state"] for server in found["servers"]}


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    """A machine whose environment is that of this process, too."""
    with closing(Machine(tmp_path)) as made:
        for name in ("COLONY_RUN_DIR", "XDG_STATE_HOME"):
            monkeypatch.setenv(name, made.environment[name])
        yield made


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A robot of a project, in a folder of its own."""
    folder = tmp_path / "robots" / "small"
    folder.mkdir(parents=True)
    (folder / "small.colony").write_text(INTERFACE)
    (folder / "small.toml").write_text(BODY)
    return folder


@pytest.fixture
def behavior(tmp_path: Path) -> Path:
    """A small behavior that checks."""
    path = tmp_path / "b.colony"
    path.write_text(
        """language 1
robot r {
  sensor near : mm range 0 .. 5000 from PServer.near
  sensor rays[3] : number from PServer.rays
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator lamp { on : bool } to DServer.Lamp idle hold
}
module cruise { when near >= 0 mm do drive(velocity = near / 1 s, turn = 0) }
module back   { when recently(bumper, 100 ms) do drive(velocity = -100 mm/s, turn = rays[0] * 1 deg/s) }
module shine  { when bumper do lamp(on = true) }
network { drive = back suppresses cruise  lamp = shine }
test "backs off" {
  at 0 s given near = 1 m, bumper = true, rays = 1 expect drive by back
  at 0.2 s given bumper = false expect drive by cruise
}
"""
    )
    return path
