"""`colony test`, `colony graph` and `colony new`."""

from __future__ import annotations

from pathlib import Path

from tests.cli.conftest import Colony


def test_tests_that_pass(colony: Colony, behavior: Path) -> None:
    code, out, _ = colony("test", behavior)
    assert code == 0
    assert out.endswith("1 passed, 0 failed\n")


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
    code, _, err = colony("graph", behavior, "-o", "b.bmp")
    assert code == 2
    assert "ends in none of .svg, .dot, .graphml" in err


def test_new_writes_a_behavior_that_checks_tests_and_compiles(colony: Colony, tmp_path: Path) -> None:
    assert colony("new", "patrol").code == 0
    assert colony("check", "patrol.colony").err == ""
    assert colony("test", "patrol.colony").code == 0
    assert colony("compile", "patrol.colony").code == 0
    before = (tmp_path / "patrol.colony").read_text()
    code, _, err = colony("new", "patrol.colony")
    assert code == 2
    assert "exists already" in err
    assert (tmp_path / "patrol.colony").read_text() == before
