"""Phases of machines: only the main file's are looked at, and only where there are no errors."""

from __future__ import annotations

from pathlib import Path

from colony.dsl.load import check_file, check_text
from tests.dsl.texts import ROBOT, findings

ENDS = "machine m { start a  a -> b when bumper }\n"


def test_what_is_said_of_machines_is_only_of_the_main_file(tmp_path: Path) -> None:
    (tmp_path / "base.colony").write_text(ROBOT + ENDS)
    (tmp_path / "main.colony").write_text('import "base.colony"\nlet ended = m == m.b\n')
    assert [d.code for d in check_file(tmp_path / "base.colony").diagnostics] == ["W011"]
    assert check_file(tmp_path / "main.colony").diagnostics == ()


def test_of_a_machine_with_an_error_only_the_error_is_told() -> None:
    assert findings(ENDS.replace("bumper", "bumpr")) == ["1:34 E101"]
    [ends] = check_text(ENDS + ROBOT).diagnostics
    assert (ends.code, ends.severity) == ("W011", "note")
