"""The README, typed in an empty folder from top to bottom."""

from __future__ import annotations

import re
import shlex
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.paths import ROOT
from tools.wheel.environments import Environment

README = (ROOT / "README.md").read_text(encoding="utf-8")

MAKE = ("make run", "make test")
"""What is for a checkout, and tried there."""

SERVE = "colony serve all"
OF_SERVERS = ("colony ps", "colony stop", "colony params", "colony data")
"""The commands that ask a robot which is served."""

HOLD, WITH_BUTTON = "colony sim hold", "colony serve all --robot amr --map loop"
"""The command that presses a button, and what serves a robot that has one."""

OF_ROS = "colony robot import"
"""The command that needs a graph of ROS 2; `tests/ros2` has one."""

BY_HAND = "colony teleop"
"""The command that needs a gamepad; `tests/cli/teleop` has one."""

WATCH = "colony watch"
"""The command that serves a page until it is ended."""

PATIENCE_S = 120.0
"""How long servers may take to start: the simulator may have to be compiled."""


def commands() -> list[str]:
    """Return the commands of the table, in order; short forms in the second column are left to `--help`."""
    rows = re.findall(r"^\| (`colony .*?) \|", README, re.MULTILINE)
    return [line for row in rows for line in re.findall(r"`(colony [^`]*)`", row)]


def _blocks(kind: str) -> list[str]:
    found: list[str] = re.findall(rf"^```{kind}[^\n]*\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    return found


def check_readme(everything: Environment, place: Path) -> None:
    """Type all that the README shows, in its order."""
    folder = place / "empty"
    folder.mkdir()
    front, script = _blocks("python")
    shown = everything.run("python", "-c", front, folder=folder).stdout
    assert shown == re.findall(r"print\(.*\)  # (.*)", front)[0] + "\n"
    (folder / "patrol.colony").write_text(_blocks("colony")[0], encoding="utf-8")
    table = everything.run("colony", "compile", "patrol.colony", folder=folder).stdout
    assert table == _blocks("text")[0]
    lines = commands()
    assert len(lines) > 20
    at = next(i for i, line in enumerate(lines) if line.startswith(SERVE))
    for line in lines[:at]:
        if line.startswith(WATCH):
            _watch(everything, line, folder)
            continue
        everything.run(*_within_a_minute(line), folder=folder, codes=_codes(line))
    asked = [line for line in lines[at + 1 :] if line.startswith(OF_SERVERS)]
    with _served(everything, lines[at], folder, "RServer"):
        everything.run("colony", "drive", "wander", "--duration", "5", folder=folder)
        everything.run("python", "-c", script, folder=folder)
        for line in (*asked, "colony stop --release"):
            everything.run(*shlex.split(line), folder=folder)
    [hold] = (line for line in lines if line.startswith(HOLD))
    with _served(everything, WITH_BUTTON, folder, "Panel"):
        everything.run(*shlex.split(hold), folder=folder)
    for line in lines[at + 1 + len(asked) :]:
        if line != hold and not line.startswith((OF_ROS, BY_HAND)):
            everything.run(*shlex.split(line), folder=folder)
    for name in ("run.mcap", "wander.svg", "run.png", "patrol/test_patrol.py", "side.seen.png"):
        assert (folder / name).exists(), name
    everything.run("pip", "install", "--quiet", "pytest", folder=folder)
    everything.run("python", "-m", "pytest", "-q", folder=folder / "patrol")


def _within_a_minute(line: str) -> list[str]:
    """Return the command, ended after ten seconds where it goes by the clock."""
    words = shlex.split(line)
    if "--processes" in words:
        words += ["--duration", "10"]
    return words


def _codes(line: str) -> list[int]:
    """Return how it may end: `diff` finds a difference."""
    return [1] if line.startswith("colony diff") else [0]


def _watch(environment: Environment, line: str, folder: Path) -> None:
    """Serve the page until its address is printed, then end it."""
    words = shlex.split(line)
    with subprocess.Popen(
        [str(environment.folder / "bin" / words[0]), *words[1:]],
        cwd=folder,
        env=environment.variables(),
        stdout=subprocess.PIPE,
        text=True,
    ) as server:
        assert server.stdout is not None
        assert server.stdout.readline().startswith("watch at http://127.0.0.1:")
        server.terminate()
        assert server.wait(60) == 0


@contextmanager
def _served(environment: Environment, line: str, folder: Path, server: str) -> Iterator[None]:
    """The servers of a robot, from when one of them answers until the end of the block."""
    words = shlex.split(line)
    servers = subprocess.Popen(
        [str(environment.folder / "bin" / words[0]), *words[1:]], cwd=folder, env=environment.variables()
    )
    try:
        until = time.monotonic() + PATIENCE_S
        while server not in environment.run("colony", "ps", folder=folder, codes=[0, 1]).stdout:
            assert time.monotonic() < until, "the servers do not start"
            time.sleep(0.5)
        yield
    finally:
        servers.terminate()
        servers.wait(60)
