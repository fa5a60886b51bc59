from __future__ import annotations

import json
from pathlib import Path

from tests.cli.conftest import Colony
from tests.paths import ROOT


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
    path.write_text("robot r { sensor sonar : mm from P.s }\nlet a = sonnar\n")
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
