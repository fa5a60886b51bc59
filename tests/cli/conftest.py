"""Commands are run in this process, as the console script runs them."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import pytest

from colony.cli.main import main
from tests.cli.machine import Machine


class Ran(NamedTuple):
    """What a command left behind."""

    code: int
    out: str
    err: str


Colony = Callable[..., Ran]


@pytest.fixture
def colony(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Colony:
    """Run `colony ARGUMENTS` in an empty directory; `stdin` is what it reads there."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str | Path, stdin: str = "") -> Ran:
        monkeypatch.setattr(sys, "argv", ["colony", *map(str, arguments)])
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin.encode())))
        with pytest.raises(SystemExit) as stopped:
            main()
        captured = capsys.readouterr()
        assert isinstance(stopped.value.code, int)
        assert "Traceback" not in captured.err
        return Ran(stopped.value.code, captured.out, captured.err)

    return run


def server_states(colony: Colony) -> dict[str, str]:
    """Return the states of the servers of the only robot, as `colony ps` shows them."""
    result = colony("ps", "--format", "json")
    assert result.code == 0
    (found,) = json.loads(result.out)
    return {server["server"]: server["state"] for server in found["servers"]}


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    """A machine whose environment is that of this process, too."""
    with closing(Machine(tmp_path)) as made:
        for name in ("COLONY_RUN_DIR", "XDG_STATE_HOME"):
            monkeypatch.setenv(name, made.environment[name])
        yield made


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
