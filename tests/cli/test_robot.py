"""`colony robot`: descriptions of robots, with their bodies."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.body.test_interface import BODY, INTERFACE
from tests.cli.conftest import Colony
from tests.cli.conftest import colony as colony


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A robot of a project, in a folder of its own."""
    folder = tmp_path / "robots" / "small"
    folder.mkdir(parents=True)
    (folder / "small.colony").write_text(INTERFACE)
    (folder / "small.toml").write_text(BODY)
    return folder


# --- check


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
    assert "robots/small/small.colony:4:12: error[B012]" in err
    assert "robots/small/small.toml:2:8: error[B010]" in err
    assert "hint: did you mean `scan`?" in err
    (small / "small.colony").write_text("language 2\nrobot small { sensor }\n")
    (small / "small.toml").write_text(BODY.replace("wheel_base", "wheelbase"))
    code, _, err = colony("robot", "check", "small")
    assert code == 1
    assert "error[E005]" in err
    assert "error[B003]" in err


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
    code, _, err = colony("robot", "check", "small")
    assert code == 2
    assert "error[B001]: cannot read `robots/small/small.toml`: No such file or directory" in err
    assert colony("robot", "check").code == 2
    assert colony("robot").code == 2
    assert colony("robot", "chek", "small").code == 2
