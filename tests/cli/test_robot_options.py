"""Every command that uses the run directory refuses an unsafe one, and `serve` needs a home folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.cli.machine import MAP, WANDER


@pytest.mark.parametrize(
    "arguments",
    [
        "ps",
        "ps --robot rome --format json",
        "stop",
        "stop --robot rome",
        "stop --robot rome --release",
        *(
            f"data {call}{robot}"
            for call in ("list", "get X", "set X 1", "delete X")
            for robot in ("", " --robot a")
        ),
        f"drive {WANDER}",
        f"shadow {WANDER}",
        f"run {WANDER} --processes --map {MAP} --duration 1",
        "serve Clock --robot rome",
        "serve DServer --robot rome",
        f"serve all --robot rome --map {MAP}",
        "serve all --robot create2 --port /dev/ttyUSB0",
        "serve RServer --robot create2 --port /dev/ttyUSB0",
        "watch --robot rome",
        "teleop --gamepad",
    ],
)
def test_a_run_directory_that_is_open_to_others_is_refused_by_every_command(
    colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: str
) -> None:
    runs = tmp_path / "r"
    runs.mkdir(mode=0o755)
    monkeypatch.setenv("COLONY_RUN_DIR", str(runs))
    ran = colony(*arguments.split())
    expected = (
        f"colony: error: {runs} is open to others (mode 0755), who could drive the robot: `chmod 700 {runs}`"
    )
    assert (ran.code, ran.err.splitlines()[-1]) == (2, expected)


@pytest.mark.parametrize("home", [None, "~", "relative"])
def test_a_user_without_a_home_folder_has_to_name_the_state(
    colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, home: str | None
) -> None:
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)  # there is no entry of this user
    if home is None:
        monkeypatch.delenv("HOME", raising=False)
    else:
        monkeypatch.setenv("HOME", home)
        monkeypatch.setenv("XDG_STATE_HOME", home)
    err = colony.refusal("serve", "DServer", "--robot", "rome")
    assert "this user has no home folder: give --state FOLDER" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("served", ["DServer", "all --map loop"])
def test_a_state_folder_that_cannot_be_made_is_to_be_named(
    colony: Colony, monkeypatch: pytest.MonkeyPatch, served: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/dev/null")
    ran = colony("serve", *served.split(), "--robot", "rome")
    expected = "/dev/null/colony/rome: Not a directory: give --state FOLDER"
    assert (ran.code, ran.err.splitlines()[-1]) == (2, expected)
