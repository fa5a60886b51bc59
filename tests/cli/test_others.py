"""`colony test` and `colony graph`."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.conftest import Colony


def test_tests_that_fail_say_what_was_found(colony: Colony, behavior: Path) -> None:
    behavior.write_text(behavior.read_text().replace("expect drive by cruise", "expect drive by back"))
    code, out, err = colony("test", behavior)
    assert code == 1
    assert "FAILED: backs off" in out
    assert "error[T001]" in err
    assert "drive by back" in err
    assert "cruise" in err


def test_graphs(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    assert colony("graph", behavior).code == 0
    svg = (tmp_path / "b.svg").read_text()
    assert svg.startswith("<svg")
    assert "cruise" in svg
    assert colony("graph", behavior, "-o", "b.dot").code == 0
    assert (tmp_path / "b.dot").read_text().startswith("digraph")
    assert colony("graph", behavior, "-o", "b.graphml").code == 0
    assert "<graphml" in (tmp_path / "b.graphml").read_text()
    err = colony.refusal("graph", behavior, "-o", "b.bmp")
    assert "expected a file ending in .svg, .dot, .graphml or .mmd" in err
    assert colony("graph", behavior, "--format", "mermaid").out == "wrote b.mmd\n"
    assert "flowchart LR" in (tmp_path / "b.mmd").read_text()


def test_a_graph_of_a_change(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    old = tmp_path / "old.colony"
    old.write_text(behavior.read_text())
    assert colony("graph", "--diff", old, behavior) == (0, "the networks are the same\n", "")
    behavior.write_text(behavior.read_text().replace("module cruise", "failsafe module cruise"))
    assert "cruise: now failsafe" in colony.output("graph", "--diff", old, behavior)
    assert colony("graph", "--diff", old, behavior, "-o", "c.mmd").code == 0
    assert '[["cruise"]]' in (tmp_path / "c.mmd").read_text()
    assert "DOT and Mermaid alone" in colony.one_line("graph", "--diff", old, behavior, "-o", "c.svg")


def test_files_with_errors_are_told_and_the_others_tested(
    colony: Colony, behavior: Path, tmp_path: Path
) -> None:
    (tmp_path / "bad.colony").write_text("let a = b\n")
    code, out, err = colony("test", "bad.colony", behavior)
    assert code == 1
    assert out.endswith("1 passed, 0 failed\n")
    assert "bad.colony:1:1: error[E301]" in err
    code, out, _ = colony("test", "--format", "json", "bad.colony", behavior)
    assert code == 1
    assert [row["code"] for row in json.loads(out)] == ["E301"]
    code, out, err = colony("test", "nowhere.colony")
    assert (code, out, err.count("\n")) == (2, "", 1)
    code, out, _ = colony("test", "--format", "json", "nowhere.colony", "bad.colony")
    assert code == 2
    assert json.loads(out)[0]["code"] == "E001"
