"""Full disks, as the table in docs/security.md has them: full before the start, and full while running."""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError
from colony.runtime.library import data
from colony.runtime.library.ask import STATUS
from colony.runtime.transport.live.run_directory import RobotDirectory, RunDirectory
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, Started, contracts_held
from tests.small_disk import SmallDisk, small_disk
from tests.waiting import until

RUN = ("run", WANDER, "--map", MAP, "--seed", "1")
NO_ROOM = "No space left on device"


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    with small_disk(tmp_path / "d", "8m") as made:
        yield made


@pytest.fixture
def machine(tmp_path: Path, disk: SmallDisk) -> Iterator[Machine]:
    """A machine whose programs have the disk."""
    with closing(Machine(tmp_path, disk.inside)) as made:
        yield made


# --- the run directory ---------------------------------------------------------------------------


@pytest.fixture
def cramped(tmp_path: Path, disk: SmallDisk) -> Iterator[Machine]:
    """A machine that has its run directory on the disk."""
    with closing(Machine(tmp_path, disk.inside, COLONY_RUN_DIR=str(disk.path / "r"))) as made:
        yield made


def directory(disk: SmallDisk) -> RobotDirectory:
    return RunDirectory(disk.seen / "r").robot(ROBOT)


PROCESSES = (*RUN, "--processes", "--no-picture")
SERVE = ("serve", "all", "--robot", ROBOT, "--map", MAP)


@pytest.mark.parametrize(
    ("command", "room"), [(PROCESSES, 0), (SERVE, 20_000), ((*SERVE, "--isolate"), 80_000)]
)
def test_a_run_directory_that_is_full_is_said_before_anything_begins(
    cramped: Machine, disk: SmallDisk, command: tuple[str, ...], room: int
) -> None:
    disk.fill(but=room)
    run = cramped.start(*command)
    assert run.wait() == 2
    assert run.err.startswith(f"colony: error: {disk.path}/r/{ROBOT}/")
    assert run.err.endswith(f": {NO_ROOM}: free some space or set COLONY_RUN_DIR to a folder of yours\n")
    assert run.err.count("\n") == 1
    assert run.out == ""
    assert directory(disk).running() == {}


@pytest.mark.long
def test_a_run_goes_on_when_its_run_directory_gets_full(cramped: Machine, disk: SmallDisk) -> None:
    options = ("--processes", "--isolate", "--no-picture", "--duration", "6", "--format", "json")
    run = cramped.start(*RUN, *options)
    until(lambda: run.ended() or "10 %" in run.err, "the robot drives")
    disk.fill()
    for server in ("RServer", "DServer"):
        pid = directory(disk).running()[server]
        os.kill(pid, signal.SIGKILL)
        until(lambda s=server, p=pid: directory(disk).running().get(s) not in (None, p), f"{server} is back")
    assert run.wait() == 0, run.err
    assert json.loads(run.out)["disagreements"] == []
    assert directory(disk).running() == {}


# --- recordings and pictures ---------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("way", "name"),
    [
        ("--processes", "run.mcap"),
        ("--realtime", "run.mcap"),
        ("--no-picture", "run.jsonl"),
    ],
)
def test_a_run_whose_recording_breaks_off_tells_what_it_was(
    machine: Machine, disk: SmallDisk, colony: Colony, way: str, name: str
) -> None:
    disk.fill(but=70_000)
    record = disk.path / name
    run = machine.start(*RUN, way, "--no-picture", "--duration", "100", "--record", str(record))
    assert run.wait() == 1
    assert f"{ROBOT}: " in run.out
    assert "broken off" in run.out
    assert f"the recording {record} contains only the first " in run.out
    assert f" s: {NO_ROOM}\n" in run.out
    assert contracts_held(run.out), run.out
    if name.endswith(".mcap"):
        kept = Path(shutil.copy(disk.seen / name, name))
        result = colony("audit", kept)
        assert result.code == 0, result.out + result.err
        assert "truncated" in result.out


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["run.mcap", "run.jsonl"])
def test_a_recording_that_cannot_begin_is_misuse(machine: Machine, disk: SmallDisk, name: str) -> None:
    disk.fill()
    record = disk.path / name
    run = machine.start(*RUN, "--no-picture", "--duration", "1", "--record", str(record))
    assert run.wait() == 2
    assert run.err.endswith(f"{record}: error: cannot write: {NO_ROOM}\n")
    assert run.out == ""


@pytest.mark.thorough
def test_a_picture_that_cannot_be_written_leaves_the_summary(machine: Machine, disk: SmallDisk) -> None:
    disk.fill()
    picture = disk.path / "run.png"
    run = machine.start(*RUN, "--duration", "1", "--picture", str(picture), "--format", "json")
    assert run.wait() == 2
    assert run.err.endswith(f"{picture}: error: cannot write: {NO_ROOM}\n")
    summary = json.loads(run.out)
    assert summary["unwritten"] == [str(picture)]
    assert summary["frames"] == 20


# --- the state folder ----------------------------------------------------------------------------


def serve(machine: Machine, disk: SmallDisk) -> Started:
    started = machine.start("serve", "all", "--robot", ROBOT, "--map", MAP, "--state", str(disk.path / "s"))
    until(lambda: started.ended() or machine.moves() or machine.stands(), "the simulator runs")
    return started


def full(server: Connection) -> tuple[str, ...]:
    """What the limits of a server are that are reached."""
    return server.do(STATUS).full


@pytest.mark.long
def test_dserver_refuses_what_must_be_kept_and_lives(machine: Machine, disk: SmallDisk) -> None:
    serve(machine, disk)
    kept: dict[str, str] = {}
    with machine.session() as session:
        server = until(lambda: _connected(session), "DServer answers")
        disk.fill()
        while (refused := _refusal(server, name := f"V{len(kept):05}", name * 200)) is None:
            kept[name] = name * 200
        assert refused.code == "full"
        assert str(disk.path / "s") in str(refused)
        assert "free some space" in str(refused)
        assert kept
        disk.fill()  # what the reserve has left of its room
        pid = machine.pid("DServer")
        assert pid is not None
        assert server.do(data.get_many(list(kept)[:100])) == dict(list(kept.items())[:100])
        assert any(str(disk.path / "s") in sentence for sentence in full(server))
        os.kill(pid, signal.SIGKILL)
        until(lambda: machine.pid("DServer") not in (None, pid), "DServer is started again")
        assert list(server.do(data.names(limit=5000))) == sorted(kept)
        shown = machine.run("ps", "--robot", ROBOT)
        assert "nothing new is kept: " in shown.out
        disk.clear()
        until(lambda: full(server) == (), "there is room again")
        server.do(data.set("again", 1))
        server.close()


@pytest.mark.thorough
def test_a_dserver_that_can_make_no_store_lives_in_memory(machine: Machine, disk: SmallDisk) -> None:
    (disk.seen / "s").mkdir(mode=0o700)
    disk.fill()
    serve(machine, disk)
    run = machine.start("drive", WANDER, "--robot", ROBOT, "--set", "DockedAt=0", "--duration", "2")
    assert run.wait() in (0, 1), run.err
    with machine.session() as session:
        server = until(lambda: _connected(session), "DServer answers")
        assert any("nothing new is kept" in sentence for sentence in full(server))
        with pytest.raises(CallRefusedError, match="free some space"):
            server.do(data.set("X", 1))
        disk.clear()
        until(lambda: full(server) == (), "there is room again")
        server.do(data.set("X", 1))
        pid = machine.pid("DServer")
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        until(lambda: machine.pid("DServer") not in (None, pid), "DServer is started again")
        assert server.do(data.get("X")) == 1
        server.close()


@pytest.mark.thorough
def test_nothing_is_lost_where_even_the_reserve_is_too_small(machine: Machine, disk: SmallDisk) -> None:
    """Values of a megabyte at one moment: the server may have to end before it answers."""
    served = serve(machine, disk)
    values = {f"V{i}": bytes([i]) * 1_000_000 for i in range(8)}
    with machine.session() as session, ExitStack() as open_:
        until(lambda: _connected(session), "DServer answers").close()
        servers = {name: open_.enter_context(session.connect("DServer", timeout_s=30.0)) for name in values}
        disk.fill()
        with ThreadPoolExecutor(len(values)) as pool:
            refused = dict(
                zip(values, pool.map(lambda n: _refusal(servers[n], n, values[n]), values), strict=True)
            )
        assert {problem.code for problem in refused.values() if problem is not None} == {"full"}
        kept = {name for name, problem in refused.items() if problem is None}
        pid = machine.pid("DServer")
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        until(lambda: machine.pid("DServer") not in (None, pid), "DServer is started again")
        server = servers["V0"]
        assert set(server.do(data.names())) == kept
        for name in kept:
            assert server.do(data.get(name)) == values[name]
    assert "Traceback" not in served.err


def _refusal(server: Connection, name: str, value: object) -> CallRefusedError | None:
    """Set a variable; gives the refusal, if it is refused."""
    try:
        server.do(data.set(name, value))
    except CallRefusedError as refused:
        return refused
    return None


def _connected(session: Session) -> Connection | None:
    try:
        return session.connect("DServer", name="test")
    except RobotConnectionError:
        return None
