"""A program in the shadow of the robot in a bag, and what it reports of the controller that drove."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Colony
from tests.ros2 import burger
from tests.ros2.bag import Written, hall, odom, scan, stamp, twist, write

pytest.importorskip("rosbags")

BOOL = "std_msgs/msg/Bool"


class Desk:
    """A folder with the robot and the behavior, and the command. Mutable: bags."""

    def __init__(self, colony: Colony, folder: Path) -> None:
        self._colony, self.folder = colony, folder
        self.program = burger.write(folder, Path("python3"))
        self.robot = f"burger={folder / 'robots' / 'burger' / 'burger.colony'}"
        self._bags = 0

    def bag(self, messages: Iterable[Written], **options: Any) -> Path:
        self._bags += 1
        return write(self.folder / f"bag{self._bags}", messages, **options)

    def command(self, *arguments: object) -> Any:
        return self._colony(*arguments)

    def shadow(self, bag: Path, *options: str) -> Any:
        return self._colony("shadow", self.program, "--robot", self.robot, "--bag", bag, *options)

    def report(self, bag: Path, *options: str) -> Any:
        result = self.shadow(bag, "--format", "json", *options)
        assert result.code == 0, result.out + result.err
        return json.loads(result.out)


@pytest.fixture
def desk(colony: Colony, tmp_path: Path) -> Desk:
    return Desk(colony, tmp_path)


def test_a_controller_that_drives_on_breaks_the_contract(desk: Desk) -> None:
    found = desk.report(desk.bag(hall(6.0)))
    assert (found["frames"], found["shadow"], found["breaches"]) == (120, True, [])
    controller = found["controller"]
    (drive,) = controller["actuators"]
    assert (drive["actuator"], drive["topic"], drive["frames"], drive["silent"]) == (
        "drive",
        "/cmd_vel",
        119,
        1,
    )
    modules = {row["module"]: row for row in drive["modules"]}
    assert modules["avoid"]["frames"] == 40
    assert modules["avoid"]["same"] == 0
    assert modules["ahead"]["frames"] == modules["ahead"]["same"] == 79
    velocity, turn = modules["avoid"]["fields"]
    assert (velocity["field"], velocity["median"], velocity["worst"]) == (
        "velocity",
        pytest.approx(0.2),
        pytest.approx(0.2),
    )
    assert turn["worst"] == pytest.approx(1.0)
    (breach,) = controller["breaches"]
    assert breach == {"contract": "clear", "frames": 40, "first_k": 1, "first_s": 0.05, "last_s": 2.0}


@pytest.mark.parametrize(
    ("storage", "compression"),
    [
        ("mcap", "none"),
        ("mcap", "storage"),
        ("mcap", "message"),
        ("sqlite3", "none"),
        ("sqlite3", "file"),
        ("sqlite3", "message"),
    ],
)
def test_every_storage_gives_the_same_report(desk: Desk, storage: Any, compression: Any) -> None:
    expected = desk.report(desk.bag(hall(3.0)))
    bag = desk.bag(hall(3.0), storage=storage, compression=compression)
    before = contents(bag)
    assert desk.report(bag) == expected
    assert contents(bag) == before
    if compression in ("none", "storage"):
        (file,) = [path for path in bag.iterdir() if path.suffix in (".mcap", ".db3")]
        assert desk.report(file) == expected
    assert contents(bag) == before


def test_the_log_of_a_killed_recorder_is_named_and_stays(desk: Desk) -> None:
    bag = desk.bag(hall(0.5), storage="sqlite3")
    (file,) = bag.glob("*.db3")
    Path(f"{file}-wal").write_bytes(b"pages that were not written back")
    before = contents(bag)
    for path in (bag, file):
        assert f"{file.name}-wal: not read, as its recorder was killed" in desk.shadow(path).err
    assert contents(bag) == before


def contents(folder: Path) -> dict[str, tuple[str, int]]:
    """Return hash and time of each file of a bag."""
    return {
        path.name: (hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_mtime_ns)
        for path in folder.iterdir()
    }


def test_its_recording_is_one_that_other_commands_read(desk: Desk) -> None:
    bag, out = desk.bag(hall(3.0)), desk.folder / "shadow.mcap"
    desk.report(bag, "--record", str(out))
    assert desk.command("audit", out).code == 0
    assert desk.command("trace", desk.program, "--robot", desk.robot, "--input", out).code == 0
    explained = desk.command("explain", out, "--at", "1", "--why", "drive")
    assert (
        "the controller commanded drive(velocity = 0.2 m/s, turn = 0 rad/s), 40 ms before the frame"
        in explained.out
    )
    assert "which broke the contract clear" in explained.out
    answer = json.loads(desk.command("explain", out, "--at", "1", "--format", "json").out)
    assert answer["controller"]["broken"] == ["clear"]
    assert answer["controller"]["commands"]["drive"]["age_ns"] == pytest.approx(40_000_000)


def test_the_table_at_the_end(desk: Desk) -> None:
    result = desk.shadow(desk.bag(hall(3.0)))
    assert "the controller commanded drive over /cmd_vel in 59 of 60 frames" in result.out
    assert "within velocity 0.004 m/s, turn 0.03 rad/s" in result.out
    assert (
        "contract clear: BROKEN by the controller in 40 frames, first at 0.05 s (frame 1), last at 2 s"
        in result.out
    )
    assert "the bag has no /lamp" in result.err


def test_a_tolerance_makes_commands_the_same(desk: Desk) -> None:
    messages = [*hall(3.0)]
    messages = [m if m.topic != "/cmd_vel" else twist(m.t_s, 0.19) for m in messages]
    bag = desk.bag(messages)
    assert desk.report(bag)["controller"]["actuators"][0]["same"] == 0
    assert desk.report(bag, "--tolerance", "3")["controller"]["actuators"][0]["same"] == 19


def test_a_command_counts_until_its_timeout(desk: Desk) -> None:
    messages = [m for m in hall(3.0) if m.topic != "/cmd_vel" or m.t_s < 1.0]
    (drive,) = desk.report(desk.bag(messages))["controller"]["actuators"]
    assert drive["frames"] == 19 + 250 // 50
    report = desk.report(desk.bag(messages))["controller"]
    assert report["breaches"][0]["last_s"] == pytest.approx(1.2)  # then it commands nothing, and stands


def test_an_old_reading_is_missing_as_live(desk: Desk) -> None:
    messages = [m for m in hall(3.0) if m.topic != "/scan" or m.t_s < 1.0]
    out = desk.folder / "shadow.jsonl"
    desk.report(desk.bag(messages), "--record", str(out))
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    last = max(row["t"] for row in rows if "ranges" in row)
    assert last == pytest.approx(0.951 + 0.3, abs=0.05)


def test_a_stamp_adds_to_the_age(desk: Desk) -> None:
    late = [scan(i / 20, header=stamp(i / 20 - 0.5, "laser")) for i in range(40)]
    out = desk.folder / "shadow.jsonl"
    desk.report(desk.bag([*late, odom(0.0)]), "--record", str(out))
    assert not any("ranges" in json.loads(line) for line in out.read_text().splitlines())


def test_a_topic_of_another_type_is_an_error_at_its_key(desk: Desk) -> None:
    result = desk.shadow(desk.bag([*hall(1.0), Written(0.5, "/lamp", BOOL, {"data": True})]))
    assert result.code == 1
    assert "error[B009]: /lamp is std_msgs/msg/Bool in the bag; expected std_msgs/msg/Float64" in result.err
    assert "ros2.lamp" in result.err


def test_what_the_bag_lacks_is_said(desk: Desk) -> None:
    result = desk.shadow(desk.bag([odom(i / 20) for i in range(20)]))
    assert "the bag has no " in result.err
    assert "/scan" in result.err
    assert "controller" not in result.out
    result = desk.shadow(desk.bag([Written(0.0, "/other", BOOL, {})]))
    assert result.code == 2
    assert "it has no topic of `burger`, but /other" in result.err


@pytest.mark.parametrize("name", ["nothing", "text.mcap", "text.db3", "text"])
def test_what_is_no_bag_is_refused(desk: Desk, name: str) -> None:
    if name != "nothing":
        (desk.folder / name).write_text("nothing of a bag" * 100)
    result = desk.shadow(desk.folder / name)
    assert result.code == 2
    assert "error: cannot read the bag: " in result.err


def test_other_commands_say_how_to_make_a_recording(desk: Desk) -> None:
    for storage in ("mcap", "sqlite3"):
        bag = desk.bag(hall(0.5), storage=storage)
        for path in (bag, next(p for p in bag.iterdir() if p.suffix in (".mcap", ".db3"))):
            result = desk.command("audit", path)
            assert result.code == 2
            assert "--bag BAG --record OUT.mcap" in result.err


def test_options_of_a_served_robot_are_refused(desk: Desk) -> None:
    result = desk.shadow(desk.bag(hall(0.5)), "--connect")
    assert result.code == 2
    assert "--connect is for a robot that is served, not for a bag" in result.err


def test_a_recording_into_the_bag_is_refused(desk: Desk) -> None:
    bag = desk.bag(hall(0.5))
    (file,) = bag.glob("*.mcap")
    before = contents(bag)
    for path, record in ((bag, file), (file, file), (bag, bag / "shadow.mcap")):
        result = desk.shadow(path, "--record", str(record))
        assert result.code == 2
        assert "would write into the bag, which is never changed" in result.err
    assert contents(bag) == before
