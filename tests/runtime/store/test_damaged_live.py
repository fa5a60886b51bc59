"""A DServer whose file is empty, damaged or no file: real processes, and the commands of an operator."""

from __future__ import annotations

import os
import signal
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.machine import ROBOT, Machine, Started
from tests.sampling import long
from tests.waiting import until

VARIABLES = 40
HERE = ("--robot", ROBOT)


def state(machine: Machine) -> Path:
    return Path(machine.environment["XDG_STATE_HOME"]) / "colony" / ROBOT


def start(machine: Machine) -> Started:
    started = machine.start("serve", "DServer", *HERE)
    until(lambda: started.ended() or "listens at" in started.err, "DServer listens")
    assert not started.ended(), started.err
    return started


def fill(machine: Machine) -> None:
    """Let a DServer keep variables, and die."""
    started = start(machine)
    with machine.session() as session, session.connect("DServer") as server:
        from colony.runtime.library import data

        server.do(data.set_many({f"V{i}": i for i in range(VARIABLES)}))
    started.tell(signal.SIGKILL)
    started.process.wait()


def empty(path: Path) -> None:
    os.truncate(path, 0)


def without_database(path: Path) -> None:
    assert path.with_name(f"{path.name}-wal").stat().st_size > 0
    path.unlink()


def wrong_value(path: Path) -> None:
    database = sqlite3.connect(path)
    database.execute("UPDATE state SET sum = sum + 1 WHERE name = 'V7'")
    database.commit()
    database.close()


@pytest.mark.parametrize("damage", [empty, long(without_database), long(wrong_value)])
def test_a_damaged_store_is_kept_aside_and_everybody_is_told(
    machine: Machine, damage: Callable[[Path], None]
) -> None:
    fill(machine)
    path = state(machine) / "DServer.sqlite"
    damage(path)
    files = [p for p in (path, path.with_name(f"{path.name}-wal")) if p.exists() and p.stat().st_size]
    before = {p.name: p.read_bytes() for p in files}
    started = start(machine)
    (line,) = [line for line in started.err.splitlines() if "is damaged" in line]
    assert line.startswith(f"{path} is damaged: ")
    assert line.endswith("it is kept as DServer.sqlite.damaged-1, and DServer starts empty")
    left = f"{path}.damaged-1-wal" if damage is without_database else f"{path}.damaged-1"
    note = f"its file was damaged, so it started empty; remove {left} when it is not needed"
    until(lambda: note in machine.run("ps", *HERE).out, "`colony ps` tells of it")
    listed = machine.run("data", "list", *HERE)
    assert (listed.wait(), listed.out, listed.err) == (0, "", f"colony: warning: DServer: {note}\n")
    kept = {p.name: p.read_bytes() for p in path.parent.glob("DServer.sqlite.damaged-1*")}
    for name, content in before.items():
        assert content in kept.values(), f"{name} is not kept byte for byte"
    assert machine.run("data", "set", "V1", "1", *HERE).wait() == 0
    for aside in path.parent.glob("*.damaged-1*"):
        aside.unlink()
    after = machine.run("data", "list", *HERE)
    assert (after.out, after.err) == ("V1\n", ""), "nothing is left to be told"
    assert not started.ended()


@pytest.mark.parametrize("name", ["DServer.sqlite", "DServer.sqlite-wal"])
@pytest.mark.parametrize("kind", ["a pipe", long("a device"), long("a folder")])
def test_what_is_no_file_is_refused_with_a_line(machine: Machine, name: str, kind: str) -> None:
    path = state(machine) / name
    path.parent.mkdir(parents=True)
    match kind:
        case "a pipe":
            os.mkfifo(path)
        case "a device":
            path.symlink_to("/dev/zero")
        case _:
            path.mkdir()
    ended = machine.run("serve", "DServer", *HERE)
    assert ended.wait() == 1
    assert f"{path} cannot be read: " in ended.err
    assert len(ended.err.splitlines()) == 1
    assert [p.name for p in path.parent.iterdir()] == [name]
