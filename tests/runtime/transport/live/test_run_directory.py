"""The folder in which the processes of a machine find each other."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import msgspec
import pytest

from colony.files import CLAIM_BYTES
from colony.runtime.transport.live import run_directory as module
from colony.runtime.transport.live.run_directory import (
    MAX_SOCKET_PATH_BYTES,
    SLOTS,
    AlreadyRunningError,
    RobotDirectory,
    RunDirectory,
    RunDirectoryError,
    in_run_directory,
)
from tests.runtime.transport.live.stage import robot_address, run_directory


def _robot(folder: Path) -> RobotDirectory:
    return RunDirectory(folder / "run").robot("rome")


@pytest.fixture
def robot(tmp_path: Path) -> RobotDirectory:
    return _robot(tmp_path)


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"COLONY_RUN_DIR": "/a/b", "XDG_RUNTIME_DIR": "/run/user/7"}, "/a/b"),
        ({"XDG_RUNTIME_DIR": "/run/user/7"}, "/run/user/7/colony"),
        ({"COLONY_RUN_DIR": ""}, f"/tmp/colony-{os.getuid()}"),
    ],
)
def test_where_it_is(environment: dict[str, str], expected: str) -> None:
    assert RunDirectory.find(environment).path == Path(expected)


def test_it_is_made_for_the_owner_alone(robot: RobotDirectory, tmp_path: Path) -> None:
    assert robot.servers() == ()
    robot.prepare()
    robot.prepare()
    assert robot.path.stat().st_mode & 0o777 == 0o700
    assert RunDirectory(tmp_path / "run").robots() == ("rome",)
    assert RunDirectory(tmp_path / "nothing").robots() == ()


def test_one_that_is_open_to_others_is_refused(robot: RobotDirectory, tmp_path: Path) -> None:
    robot.prepare()
    robot.path.parent.chmod(0o750)
    with pytest.raises(RunDirectoryError, match=r"open to others \(mode 0750\).*chmod 700"):
        robot.prepare()


def test_a_link_or_a_file_in_its_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir(mode=0o700)
    (tmp_path / "run").symlink_to(tmp_path / "other")
    with pytest.raises(RunDirectoryError, match="is not a folder"):
        _robot(tmp_path).prepare()
    (tmp_path / "file").write_text("")
    with pytest.raises(RunDirectoryError, match="set COLONY_RUN_DIR"):
        RunDirectory(tmp_path / "file").robot("rome").prepare()


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_somebody_elses_is_refused(robot: RobotDirectory, tmp_path: Path) -> None:
    robot.prepare()
    os.chown(robot.path, 12345, 12345)
    with pytest.raises(RunDirectoryError, match="belongs to user 12345, and this is user 0"):
        robot.prepare()


@pytest.mark.parametrize("name", ["", "a/b", "..", "a*", "@a", "-a", "x" * 65, "a b", "rôme"])
def test_names_that_are_none(tmp_path: Path, name: str) -> None:
    with pytest.raises(RunDirectoryError, match="cannot be the name of a robot"):
        RunDirectory(tmp_path).robot(name)
    with pytest.raises(RunDirectoryError, match="cannot be the name of a server"):
        _robot(tmp_path).socket(name)


def test_a_socket_with_too_long_a_path_is_refused(tmp_path: Path) -> None:
    folder = Path("/tmp") / ("x" * (MAX_SOCKET_PATH_BYTES - len("/tmp//rome/RServer.sock")))
    robot = RunDirectory(folder).robot("rome")
    assert len(str(robot.socket("RServer"))) == MAX_SOCKET_PATH_BYTES
    with pytest.raises(RunDirectoryError, match=r"108 bytes long.*107.*COLONY_RUN_DIR to a shorter"):
        robot.socket("RServerX")


@pytest.mark.parametrize("sign", "#?")
def test_a_folder_that_no_endpoint_can_have_is_refused(tmp_path: Path, sign: str) -> None:
    with pytest.raises(RunDirectoryError, match=rf"because it contains `\{sign}`: set COLONY_RUN_DIR"):
        RunDirectory(tmp_path / f"a b{sign}").robot("rome").socket("RServer")


def test_a_folder_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    folder = Path(os.fsdecode(bytes(tmp_path) + b"/\xff"))
    with pytest.raises(RunDirectoryError, match="must be UTF-8"):
        RunDirectory(folder).robot("rome").socket("RServer")


def test_a_claim_keeps_its_room(robot: RobotDirectory, tmp_path: Path) -> None:
    sizes = set()
    for _ in range(2):
        with robot.claim("RServer"):
            sizes.add((robot.path / "RServer.claim").stat().st_size)
            assert robot.running() == {"RServer": os.getpid()}
        sizes.add((robot.path / "RServer.claim").stat().st_size)
    assert sizes == {CLAIM_BYTES}


def test_what_is_wrong_with_a_file_is_said_with_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "RServer.claim"
    with pytest.raises(RunDirectoryError) as failed, in_run_directory(path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert str(failed.value) == (
        f"{path}: No space left on device: free some space or set COLONY_RUN_DIR to a folder of yours"
    )
    with pytest.raises(RunDirectoryError) as failed, in_run_directory(path):
        raise OSError(errno.EROFS, "Read-only file system", "/other")
    assert str(failed.value) == "/other: Read-only file system: set COLONY_RUN_DIR to a folder of yours"
    with pytest.raises(RunDirectoryError) as failed, in_run_directory(path):
        raise OSError(errno.EFBIG, "File too large")
    assert str(failed.value) == f"{path}: File too large: raise the limit of file sizes (`ulimit -f`)"
    with pytest.raises(OSError, match="Too many open files"), in_run_directory(path):
        raise OSError(errno.EMFILE, "Too many open files")


def test_a_server_is_claimed_by_one_process_at_a_time(robot: RobotDirectory, tmp_path: Path) -> None:
    with robot.claim("RServer") as claim, robot.claim("DServer"):
        assert robot.running() == {"DServer": os.getpid(), "RServer": os.getpid()}
        with pytest.raises(
            AlreadyRunningError, match=f"RServer of rome is already running, as process {os.getpid()}"
        ):
            robot.claim("RServer")
        claim.close()
        assert robot.running() == {"DServer": os.getpid()}
        robot.claim("RServer").close()
    assert robot.running() == {}


def test_the_claim_of_a_process_that_was_killed_is_free(robot: RobotDirectory, tmp_path: Path) -> None:
    script = (
        "import os, signal, sys; from pathlib import Path\n"
        "from colony.runtime.transport.live.run_directory import RunDirectory\n"
        "claim = RunDirectory(Path(sys.argv[1])).robot('rome').claim('RServer')\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ended = subprocess.run([sys.executable, "-c", script, str(tmp_path / "run")], check=False)
    assert ended.returncode == -9
    assert (robot.path / "RServer.claim").read_text().strip().isdigit()
    assert robot.running() == {}
    robot.claim("RServer").close()


def test_time_begins_once_for_all_processes(robot: RobotDirectory, tmp_path: Path) -> None:
    assert robot.origin_ns(monotonic=lambda: 1000) == 1000
    assert robot.origin_ns(monotonic=lambda: 2000) == 1000
    script = (
        "import sys; from pathlib import Path\n"
        "from colony.runtime.transport.live.run_directory import RunDirectory\n"
        "print(RunDirectory(Path(sys.argv[1])).robot(sys.argv[2]).origin_ns())\n"
    )
    run = [
        subprocess.Popen(
            [sys.executable, "-c", script, str(tmp_path / "run"), "siena"], stdout=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    assert len({process.communicate()[0] for process in run}) == 1


def test_time_goes_on_after_the_machine_was_started_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, boot = _robot(tmp_path), tmp_path / "boot_id"
    wall = iter((10_000, 17_000, 17_000))
    monkeypatch.setattr(module.time, "time_ns", lambda: next(wall))
    monkeypatch.setattr(module, "BOOT_ID", boot)
    boot.write_text("first\n")
    assert robot.origin_ns(monotonic=lambda: 5000) == 5000
    boot.write_text("second\n")
    base = robot.origin_ns(monotonic=lambda: 100)
    assert 100 - base == 7000
    assert robot.origin_ns(monotonic=lambda: 300) == base


def test_a_base_that_cannot_be_read_is_told_of(robot: RobotDirectory, tmp_path: Path) -> None:
    robot.prepare()
    (robot.path / "base").write_bytes(msgspec.json.encode({"boot": 3}))
    with pytest.raises(RunDirectoryError, match=r"base: .*remove it"):
        robot.origin_ns()


def test_place_of_a_robot_of_this_machine() -> None:
    with run_directory() as environment:
        assert robot_address(environment).robot == "rome"
        with pytest.raises(RunDirectoryError):
            robot_address(environment | {"COLONY_RUN_DIR": "x" * 200}).directory.socket("RServer")


def test_robots_are_not_looked_for_where_others_could_have_put_them(tmp_path: Path) -> None:
    assert RunDirectory(tmp_path / "none").robots() == ()
    (tmp_path / "file").write_text("")
    with pytest.raises(RunDirectoryError, match="is not a folder"):
        RunDirectory(tmp_path / "file").robots()
    (tmp_path / "open").mkdir(mode=0o755)
    with pytest.raises(RunDirectoryError, match="open to others"):
        RunDirectory(tmp_path / "open").robots()


@pytest.mark.parametrize("name", ["RServer.claim", "base"])
def test_what_is_no_file_in_the_folder_of_a_robot(tmp_path: Path, name: str) -> None:
    directory = RunDirectory(tmp_path / "r").robot("rome")
    directory.prepare()
    os.mkfifo(directory.path / name)
    assert directory.running() == {}
    use = directory.origin_ns if name == "base" else lambda: directory.claim("RServer")
    with pytest.raises(RunDirectoryError, match=f"{name}: it is not a regular file"):
        use()


def test_a_slot_is_kept_over_restarts_until_its_server_is_gone_and_another_comes(
    robot: RobotDirectory,
) -> None:
    with robot.claim("Arm"), robot.claim("Lift.2"):
        assert [robot.take_slot(name) for name in ("Arm", "Lift.2", "Arm")] == [0, 1, 0]
        assert (robot.path / "1.slot").readlink() == Path("Lift.2.sock")
    with robot.claim("Lift.2"), robot.claim("Hand"), robot.claim("Arm"):
        assert [robot.take_slot(name) for name in ("Lift.2", "Hand", "Arm")] == [1, 2, 0]
    with robot.claim("Lift.2"), robot.claim("Claw"):
        assert [robot.take_slot(name) for name in ("Claw", "Lift.2")] == [0, 1]
    with robot.claim("Arm"):
        assert robot.take_slot("Arm") == 0


def test_more_servers_than_slots_are_refused(robot: RobotDirectory) -> None:
    with ExitStack() as claims:
        for number in range(SLOTS):
            claims.enter_context(robot.claim(f"Arm{number}"))
            assert robot.take_slot(f"Arm{number}") == number
        claims.enter_context(robot.claim("Hand"))
        with pytest.raises(RunDirectoryError, match=f"rome has {SLOTS} servers .*: Hand is too many"):
            robot.take_slot("Hand")
