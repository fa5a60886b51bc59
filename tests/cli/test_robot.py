"""`colony robot`: descriptions of robots, with their bodies."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from colony.shipped import Shipped
from tests.body.test_disagreements import BODY, INTERFACE
from tests.cli.conftest import Colony

# --- check


@pytest.mark.parametrize("name", Shipped.ROBOT.names())
def test_robots_that_come_with_colony_agree(colony: Colony, name: str) -> None:
    checked = colony("robot", "check", name)
    assert (checked.code, checked.out) == (0, f"{name}: ok\n")
    if name == "create2":
        assert "warning[B019]: nothing stops `RServer` when its computer fails" in checked.err
        assert checked.err.count("warning") == 1
    else:
        assert checked.err == ""


def test_robots_that_agree(colony: Colony, small: Path) -> None:
    assert colony("robot", "check", "rome", "small") == (0, "rome: ok\nsmall: ok\n", "")
    for path in ("robots/small", "robots/small/small.colony", small / "small.colony"):
        assert colony("robot", "check", path).code == 0


def test_a_robot_of_a_project_is_found_from_a_folder_below(
    colony: Colony, small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (small.parents[1] / "colony.toml").write_text("")
    (small.parents[1] / "deep").mkdir()
    monkeypatch.chdir(small.parents[1] / "deep")
    assert colony("robot", "check", "small").code == 0


def test_what_is_wrong_in_both_files_is_reported(colony: Colony, small: Path) -> None:
    (small / "small.colony").write_text(INTERFACE.replace("Lidar.scan", "Lidar.scn"))
    (small / "small.toml").write_text(BODY.replace('name = "small"', 'name = "tiny"'))
    code, out, err = colony("robot", "check", "rome", "small")
    assert (code, out) == (1, "rome: ok\n")
    assert "robots/small/small.colony:4:12: error[R002]" in err
    assert "robots/small/small.toml:2:8: error[B010]" in err
    assert "hint: did you mean `scan`?" in err
    (small / "small.colony").write_text("language 1\nrobot small { sensor }\n")
    (small / "small.toml").write_text(BODY.replace("wheel_base", "wheelbase"))
    err = colony.refusal("robot", "check", "small", code=1)
    assert "error[E005]" in err
    assert "error[B003]" in err


def test_the_body_is_called_like_the_robot_and_not_like_the_file(colony: Colony, small: Path) -> None:
    (small / "small.colony").rename(small / "other.colony")
    assert colony("robot", "check", small / "other.colony").code == 0
    (small / "small.toml").rename(small / "other.toml")
    err = colony.refusal("robot", "check", small / "other.colony")
    assert f"error[B001]: cannot read `{Path('robots/small/small.toml')}`" in err


def test_a_warning_is_no_error(colony: Colony, small: Path) -> None:
    (small / "small.toml").write_text(BODY + '[server.Arm]\nhardware = { driver = "arm:Arm" }\n')
    code, out, err = colony("robot", "check", "small")
    assert (code, out) == (0, "small: ok\n")
    assert "warning[B018]" in err


def test_formats_for_programs(colony: Colony, small: Path) -> None:
    (small / "small.toml").write_text(BODY.replace('name = "small"', 'name = "tiny"'))
    code, out, err = colony("robot", "check", "rome", "small", "--format", "json")
    assert (code, err) == (1, "")
    [found] = json.loads(out)
    assert (found["code"], found["file"], found["line"]) == ("B010", "robots/small/small.toml", 2)
    code, out, _ = colony("robot", "check", "small", "--format", "sarif")
    assert code == 1
    assert json.loads(out)["runs"][0]["results"][0]["ruleId"] == "B010"
    assert json.loads(colony("robot", "check", "rome", "--format", "json").out) == []


def test_what_cannot_be_read(colony: Colony, small: Path) -> None:
    code, _, err = colony("robot", "check", "smal")
    assert (code, err) == (2, "error: there is no description `smal` (did you mean `small`?)\n")
    (small / "small.toml").unlink()
    err = colony.refusal("robot", "check", "small")
    assert "error[B001]: cannot read `robots/small/small.toml`: No such file or directory" in err
    assert colony("robot", "check").code == 2
    assert colony("robot").code == 2
    assert colony("robot", "chek", "small").code == 2


@pytest.mark.parametrize("command", ["check", "show"])
def test_a_body_is_no_interface(colony: Colony, small: Path, command: str) -> None:
    for body in ("robots/small/small.toml", "none.toml"):
        code, out, err = colony("robot", command, body)
        advice = (
            f"give the interface beside it, {body[:-5]}.colony, or the name of the robot, {Path(body).stem}"
        )
        assert (code, out, err) == (2, "", f"error: `{body}` is no interface of a robot ({advice})\n")


def test_control_characters_of_a_file_do_not_reach_the_terminal(colony: Colony, small: Path) -> None:
    (small / "small.toml").write_text(
        BODY.replace('"small"', '"\\u001b[2J"').replace("[robot]", "[robot]\n#\r\n")
    )
    err = colony.refusal("robot", "check", "small", code=1)
    assert "\x1b" not in err
    assert "\\x1b[2J" in err


# --- show


def test_a_base_that_drives_sideways_is_listed_with_its_limits(colony: Colony) -> None:
    code, out, err = colony("robot", "show", "omni")
    assert (code, err) == (0, "")
    assert out.splitlines()[1:4] == [
        "  omnidirectional drive, wheels 180 mm apart, axles 160 mm; frames of 50 ms",
        "  at most 600 mm/s and 120 deg/s, 1000 mm/s^2 and 360 deg/s^2",
        "  sideways at most 400 mm/s, 800 mm/s^2",
    ]


def test_a_driver_is_listed_beside_its_device(colony: Colony, small: Path) -> None:
    driver = "lidar, colony.drivers.ldlidar:LD06"
    assert f"  celsius    degC                 Lidar.temperature  {driver}  2 s     1 Hz" in colony.output(
        "robot", "show", "small"
    )


def test_rome_is_listed_with_its_cameras(colony: Colony) -> None:
    out = colony.output("robot", "show", "rome")
    assert "  CServerSide      images                    CServerSide             camera\n" in out


def test_what_has_errors_is_not_shown(colony: Colony, small: Path) -> None:
    (small / "small.toml").write_text(BODY.replace('name = "small"', 'name = "tiny"'))
    assert "error[B010]" in colony.refusal("robot", "show", "small", "--picture", "small.png", code=1)
    assert not Path("small.png").exists()
    (small / "small.toml").unlink()
    assert colony("robot", "show", "small").code == 2
    assert colony("robot", "show", "rome", "--picture", "rome.gif").code == 2
    assert colony("robot", "show", "rome", "--picture", "none/rome.png").code == 2


# --- new


def test_a_new_robot_checks_and_runs_wander(colony: Colony) -> None:
    out = colony.output("robot", "new", "scout")
    assert out == (
        "wrote robots/scout/scout.colony and robots/scout/scout.toml; try: colony robot check scout\n"
    )
    assert colony("robot", "check", "scout") == (0, "scout: ok\n", "")
    assert colony("robot", "show", "scout").code == 0
    code, out, err = colony("test", "wander", "--robot", "scout")
    assert (code, err) == (0, "")
    assert out.endswith("7 passed, 0 failed\n")
    assert colony("verify", "robots/scout/scout.colony").code == 0


@pytest.mark.parametrize("name", Shipped.ROBOT.names())
def test_a_new_robot_does_not_hide_one_that_comes_with_colony(colony: Colony, name: str) -> None:
    err = colony.refusal("robot", "new", name)
    assert f"`{name}` comes with colony, and would no longer be found; choose another name" in err
    assert not Path("robots").exists()


def test_nothing_is_overwritten(colony: Colony, small: Path) -> None:
    before = {path: path.read_text() for path in small.iterdir()}
    code, _, err = colony("robot", "new", "small")
    assert (code, err) == (2, "robots/small/small.colony: error: cannot write: it exists already\n")
    assert {path: path.read_text() for path in small.iterdir()} == before
    (small / "small.colony").unlink()
    assert colony("robot", "new", "small").code == 2
    Path("robots/flat.colony").write_text("")
    assert colony("robot", "new", "flat").code == 2
    Path("robots/file").write_text("")
    assert colony("robot", "new", "file").code == 2


@pytest.mark.parametrize("name", ["", "a b", "a/b", "..", "1a", "a" * 65, "true", "and", "naïve"])
def test_what_is_no_name(colony: Colony, name: str) -> None:
    assert "expected a name" in colony.refusal("robot", "new", name)
    assert not Path("robots").exists()
