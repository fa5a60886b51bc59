from __future__ import annotations

import json
from pathlib import Path

from tests.cli.conftest import Colony


def test_the_table(colony: Colony, behavior: Path) -> None:
    code, out, _ = colony("compile", behavior)
    assert code == 0
    assert out.index("back") < out.index("cruise")


def test_explain_shows_the_steps(colony: Colony, behavior: Path) -> None:
    code, out, _ = colony("compile", "--explain", behavior)
    assert code == 0
    assert "cruise-back" in out


def test_json_is_the_documented_form(colony: Colony, behavior: Path) -> None:
    document = json.loads(colony("compile", "--format", "json", behavior).out)
    assert document["format"] == "colony-clients/1"
    clients = document["actuators"]["drive"]["clients"]
    assert [(c["priority"], c["module"]) for c in clients] == [(2, "back"), (1, "cruise")]
    assert all(0 <= c["guard"] < len(document["nodes"]) for c in clients)


def test_generated_python_runs_alone(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    target = tmp_path / "b.py"
    assert colony("compile", "--format", "python", behavior, "-o", target).code == 0
    assert "import colony" not in target.read_text()
    compile(target.read_text(), str(target), "exec")


def test_errors_leave_no_output(colony: Colony, tmp_path: Path) -> None:
    path = tmp_path / "bad.colony"
    path.write_text("let a = 1 mm + 1 s")
    target = tmp_path / "out.json"
    assert colony("compile", path, "--format", "json", "-o", target).code == 1
    assert not target.exists()
    assert colony("compile", tmp_path / "none.colony").code == 2


def test_an_output_that_cannot_be_written(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    code, _, err = colony("compile", behavior, "-o", tmp_path / "no" / "such" / "x.txt")
    assert code == 2
    assert "cannot write: there is no such folder" in err
