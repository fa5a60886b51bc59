from __future__ import annotations

import json
from pathlib import Path

import pytest

from colony.body.reader import read_body
from tests.body.test_disagreements import BODY, INTERFACE
from tests.cli.conftest import Colony
from tests.paths import BEHAVIORS, ROOT


def test_good_files(colony: Colony, behavior: Path) -> None:
    assert colony("check", behavior, ROOT / "behaviors" / "wander.colony").code == 0


def test_all_errors_with_place_caret_and_hint(colony: Colony, tmp_path: Path) -> None:
    path = tmp_path / "bad.colony"
    path.write_text("robot r { sensor sonar : mm from P.s }\nlet a = sonnar\nlet b = 3 mm + 2 s\n")
    err = colony.refusal("check", path, code=1)
    assert f"{path}:2:9: error[E101]: unknown name `sonnar`" in err
    assert "hint: did you mean `sonar`?" in err
    assert f"{path}:3:9: error[E201]" in err
    assert "        ^^^^^^^^^^" in err


def test_warnings_alone_are_good(colony: Colony, behavior: Path) -> None:
    behavior.write_text(behavior.read_text() + "module spare { when true do lamp(on = true) }\n")
    code, out, err = colony("check", behavior)
    assert code == 0
    assert "warning[W001]: module `spare` reaches no actuator" in err
    assert out.endswith(": ok\n")


def test_json(colony: Colony, tmp_path: Path) -> None:
    path = tmp_path / "bad.colony"
    path.write_text("language 1 robot r { sensor sonar : mm from P.s }\nlet a = sonnar\n")
    code, out, _ = colony("check", "--format", "json", path)
    (row,) = json.loads(out)
    assert code == 1
    assert (row["line"], row["column"], row["code"], row["severity"]) == (2, 9, "E101", "error")


def test_unreadable_files_are_misuse(colony: Colony, tmp_path: Path) -> None:
    for path in (tmp_path / "none.colony", tmp_path):
        assert f"{path}:1:1: error[E001]: cannot read" in colony.one_line("check", path)


# --- the version of the language ---------------------------------------------------------------------

ROBOT = "robot r { sensor bumper : bool from RServer.bumper }\n"


def test_a_file_that_names_no_version_gets_a_note(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "a.colony").write_text(ROBOT)
    code, out, err = colony("check", "a.colony")
    assert (code, out) == (0, "a.colony: ok\n")
    assert err.startswith("a.colony:1:1: note[N001]: read as version 1 of the language\n")
    assert "hint: write `language 1` before the first declaration" in err
    rows = json.loads(colony("check", "--format", "json", "a.colony").out)
    assert [(row["code"], row["severity"]) for row in rows] == [("N001", "note"), ("N003", "note")]


def test_each_file_is_noted_once_and_no_shipped_one(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "a.colony").write_text(ROBOT)
    (tmp_path / "b.colony").write_text('language 1\nimport "a.colony"\n')
    (tmp_path / "c.colony").write_text('import "a.colony"\n')
    assert colony("check", "b.colony").err.count("note[N001]") == 1
    err = colony("check", "a.colony", "b.colony", "c.colony", "a.colony", "wander").err
    assert [line.partition(":")[0] for line in err.splitlines() if "note[N001]" in line] == [
        "a.colony",
        "c.colony",
    ]


@pytest.mark.parametrize(
    "arguments",
    [
        ("compile", "a.colony", "--no-proof"),
        ("test", "a.colony"),
        ("graph", "a.colony", "-o", "-.svg"),
        ("trace", "a.colony", "--input", "-"),
    ],
)
def test_other_commands_give_no_note(colony: Colony, behavior: Path, arguments: tuple[str, ...]) -> None:
    text = behavior.read_text()
    Path("a.colony").write_text(text.replace("language 1\n", ""))
    code, _, err = colony(*arguments)
    assert code == 0
    assert "note" not in err


def test_a_file_that_cannot_be_read_to_its_end_gets_errors_only(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "a.colony").write_text(ROBOT + "language 1\n")
    err = colony.refusal("check", "a.colony", code=1)
    assert "hint: a file has this line once, before its first declaration" in err
    assert "note[N001]" not in err


def test_every_shipped_behavior_names_its_version(colony: Colony) -> None:
    files = [*BEHAVIORS, *sorted((ROOT / "examples").rglob("*.colony"))]
    assert len(files) > 12
    code, _, err = colony("check", *files)
    assert code == 0
    assert "note[N001]" not in err


# --- the body of the robot

GO = """language 1
import robot
module go { when true do drive(velocity = 0, turn = 0) }
network { drive = go }
"""


@pytest.fixture(autouse=True)
def go(colony: Colony) -> None:
    """A behavior for any robot."""
    Path("go.colony").write_text(GO)


def test_a_program_that_fits_the_body_of_its_robot(colony: Colony, small: Path) -> None:
    assert colony("check", "go.colony", "--robot", "small") == (0, "go.colony: ok\n", "")
    Path("own.colony").write_text(GO.replace("import robot", 'import "robots/small/small.colony"'))
    assert colony("check", "own.colony") == (0, "own.colony: ok\n", "")


def test_errors_in_either_file_of_a_robot(colony: Colony, small: Path) -> None:
    (small / "small.colony").write_text(INTERFACE.replace("Lidar.scan", "Lidar.scn"))
    (small / "small.toml").write_text(
        BODY.replace('rate = "10 Hz"', 'rate = "4 Hz"').replace('"1 Hz"', '"0.1 Hz"')
    )
    err = colony.refusal("check", "go.colony", "--robot", "small", code=1)
    assert "robots/small/small.colony:4:12: error[R002]: `scan`: Lidar has no field `scn`" in err
    assert "hint: did you mean `scan`?" in err
    assert "robots/small/small.toml:17:31: error[B017]: `celsius` is measured every 10 s" in err
    code, out, _ = colony("check", "go.colony", "--robot", "small", "--format", "json")
    assert code == 1
    assert {(d["code"], d["file"]) for d in json.loads(out) if d["severity"] == "error"} == {
        ("R002", "robots/small/small.colony"),
        ("B017", "robots/small/small.toml"),
    }
    code, out, _ = colony("check", "go.colony", "--robot", "small", "--format", "sarif")
    assert code == 1
    assert {"R002", "B017"} <= {result["ruleId"] for result in json.loads(out)["runs"][0]["results"]}


def test_a_body_that_cannot_be_used(colony: Colony, small: Path) -> None:
    (small / "small.toml").write_text(BODY.replace("wheel_base", "wheelbase"))
    err = colony.refusal("check", "go.colony", "--robot", "small", code=1)
    assert "robots/small/small.toml:6:34: error[B003]: `body.drive` has no key `wheelbase`" in err


def test_findings_about_the_body_of_one_of_several_robots(colony: Colony, small: Path) -> None:
    (small / "small.toml").write_text(BODY.replace('"0.5 m/s"', '"0.4 m/s"'))
    err = colony.refusal("check", "go.colony", "--robot", "rome", "--robot", "small", code=1)
    assert "error[B016]: `small`: `drive.velocity` reaches -0.5 m/s, and the base at most 0.4 m/s" in err


def test_a_body_is_read_once_a_command(colony: Colony, small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[object] = []
    monkeypatch.setattr("colony.body.reader.read_body", lambda path: read.append(path) or read_body(path))
    Path("b.colony").write_text(GO)
    assert colony("check", "go.colony", "b.colony", "--robot", "small", "--robot", "s=small").code == 0
    assert len(read) == 1


OWN = """language 1
robot tug {
  sensor   hit : bool  from RServer.bumper
  actuator drive { velocity : mm/s range -300 .. 300 }  to RServer.drive  idle drive(velocity = 0)
}
module go { when hit do drive(velocity = 0) }
network { drive = go }
"""


def test_a_robot_without_a_body_is_noted_once(colony: Colony, tmp_path: Path) -> None:
    Path("own.colony").write_text(OWN)
    Path("more.colony").write_text('language 1\nimport "own.colony"\n')
    assert colony("check", "own.colony", "more.colony").err.count("note[N003]: `tug` has no body") == 1


def test_the_note_says_whether_the_robot_fits_the_body_that_it_gets(colony: Colony, tmp_path: Path) -> None:
    Path("own.colony").write_text(
        OWN.replace("RServer.bumper", "Bumper.front").replace("RServer.drive", "A.b")
    )
    end = "which does not fit: `hit`: there is no server `Bumper`, and 1 more\n"
    assert colony("check", "own.colony").err.endswith(end)
    err = colony.refusal(
        "run", "own.colony", "--map", ROOT / "maps" / "loop.stickrep", "--no-picture", code=1
    )
    assert "error[R001]: `hit`: there is no server `Bumper`" in err


def test_a_robot_that_shares_variables_alone_needs_no_body(colony: Colony, tmp_path: Path) -> None:
    Path("own.colony").write_text(
        OWN.replace("RServer.bumper", "DServer.Hit").replace("RServer.drive", "DServer.V")
    )
    assert colony("check", "own.colony") == (0, "own.colony: ok\n", "")


@pytest.mark.parametrize("command", ["run --map loop --no-picture", "drive"])
def test_a_run_is_refused_as_the_check_says(colony: Colony, small: Path, command: str) -> None:
    (small / "small.toml").write_text(BODY.replace('"0.5 m/s"', '"0.4 m/s"'))
    err = colony.refusal(*command.split(), "go.colony", "--robot", "small", code=1)
    assert "error[B016]: `drive.velocity` reaches -0.5 m/s, and the base at most 0.4 m/s" in err
    assert colony("test", "go.colony", "--robot", "small").code == 0  # which needs no body
