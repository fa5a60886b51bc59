"""docs/drivers.md: its robot checks, drives over a pseudoterminal, and stands when its driver is killed."""

from __future__ import annotations

import configparser
import re
from pathlib import Path

import pytest

from colony.drivers.guard_outbox import REPEATS_NS
from colony.drivers.serial_base import DEADLINE_FRAMES, DEADLINE_NS
from tests.pages import COMMANDS, typed
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "drivers.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```\w+ file=(\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def write_files(folder: Path) -> None:
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def test_commands_print_what_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_files(tmp_path)
    ((commands, shown),) = COMMANDS.findall(PAGE)
    printed = "".join(typed(command, monkeypatch, errors=True) for command in commands.splitlines())
    assert sorted(printed.splitlines()) == sorted(shown.splitlines())


def test_the_page_has_the_times_of_the_guard() -> None:
    assert f"for {DEADLINE_NS // 1_000_000} ms, or for three frames" in PAGE
    assert DEADLINE_FRAMES == 3
    first, second, third = (t_ns // 1_000_000 for t_ns in REPEATS_NS[1:])
    assert f"after {first}, {second} and {third} ms" in " ".join(PAGE.split())


def test_the_unit_is_one() -> None:
    unit = configparser.ConfigParser(strict=True)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read_string(FILES["rover.service"])
    assert unit["Service"]["ExecStart"].endswith("serve all --robot r1=rover --port /dev/rover")
