from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.paths import BEHAVIORS, ROOT


def test_good_files(colony: Colony, behavior: Path) -> None:
    assert colony("check", behavior, ROOT / "behaviors" / "wander.colony").code == 0


def test_all_errors_with_place_caret_and_hint(colony: Colony, tmp_path: Path) -> None:
    path = tmp_path / "bad.colony"
    path.write_text("robot r { sensor sonar : mm from P.s }\nlet a = sonnar\nlet b = 3 mm + 2 s\n")
    code, out, err = colony("check", path)
    assert code == 1
    assert out == ""
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
    path.write_text("language 2 robot r { sensor sonar : mm from P.s }\nlet a = sonnar\n")
    code, out, _ = colony("check", "--format", "json", path)
    (row,) = json.loads(out)
    assert code == 1
    assert (row["line"], row["column"], row["code"], row["severity"]) == (2, 9, "E101", "error")


def test_unreadable_files_are_misuse(colony: Colony, tmp_path: Path) -> None:
    for path in (tmp_path / "none.colony", tmp_path):
        code, _, err = colony("check", path)
        assert code == 2
        assert f"{path}:1:1: error[E001]: cannot read" in err
        assert err.count("\n") == 1


# --- the version of the language ---------------------------------------------------------------------

ROBOT = "robot r { sensor bumper : bool from RServer.bumper }\n"


def test_a_file_that_names_no_version_gets_a_note(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "a.colony").write_text(ROBOT)
    code, out, err = colony("check", "a.colony")
    assert (code, out) == (0, "a.colony: ok\n")
    assert err.startswith("a.colony:1:1: note[N001]: read as version 2 of the language\n")
    assert "hint: write `language 2` before the first declaration" in err
    (row,) = json.loads(colony("check", "--format", "json", "a.colony").out)
    assert (row["code"], row["severity"]) == ("N001", "note")


def test_each_file_is_noted_once_and_no_shipped_one(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "a.colony").write_text(ROBOT)
    (tmp_path / "b.colony").write_text('language 2\nimport "a.colony"\n')
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
    Path("a.colony").write_text(text.replace("language 2\n", ""))
    code, _, err = colony(*arguments)
    assert code == 0
    assert "note" not in err


def test_a_file_that_cannot_be_read_to_its_end_gets_errors_only(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "a.colony").write_text(ROBOT + "language 2\n")
    code, _, err = colony("check", "a.colony")
    assert code == 1
    assert "hint: a file has this line once, before its first declaration" in err
    assert "note[N001]" not in err


def test_every_shipped_behavior_names_its_version(colony: Colony) -> None:
    files = [*BEHAVIORS, *sorted((ROOT / "examples").rglob("*.colony"))]
    assert len(files) > 12
    code, _, err = colony("check", *files)
    assert code == 0
    assert "note[N001]" not in err
