"""What the README shows is what the program does."""

from __future__ import annotations

import re

from colony.compile.backends.table import client_table
from colony.compile.pipeline import compile_program
from colony.dsl.load import check_text
from tests.paths import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def _fenced(kind: str) -> str:
    found = re.search(rf"```{kind}\n(.*?)```", README, re.DOTALL)
    assert found
    return found[1]


def test_the_behavior_checks_and_compiles_to_what_is_shown() -> None:
    checked = check_text(_fenced("colony"))
    assert checked.diagnostics == ()
    assert checked.program is not None
    assert client_table(compile_program(checked.program)).strip() == _fenced("text").strip()


def test_the_first_commands_are_make_run_and_make_test() -> None:
    assert _fenced("sh").split("\n")[:2] == ["make run", "make test"]
