"""The commands on docs/recordings.md do what is shown below them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from colony.dsl.check.robot import RESERVED_FIELDS
from colony.runtime.recordings.replay import RESERVED
from colony.runtime.recordings.schemas import CONTRACTS, FRAMES, KEYFRAMES, REQUESTS, VERDICTS
from tests.pages import COMMANDS, is_same_picture, typed
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "recordings.md").read_text(encoding="utf-8")
EXAMPLES = COMMANDS.findall(PAGE)


def test_commands_print_what_the_page_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("behaviors", "maps"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    monkeypatch.chdir(tmp_path)
    assert len(EXAMPLES) == 4
    for commands, shown in EXAMPLES:
        printed = [typed(line, monkeypatch) for line in commands.splitlines()]
        assert printed[-1] == shown
    assert "](scan.svg)" in PAGE
    assert is_same_picture(tmp_path / "scan.svg", ROOT / "docs" / "scan.svg")


def test_every_name_is_told_of() -> None:
    for name in (*RESERVED, *RESERVED_FIELDS):
        assert f"`{name}`" in PAGE or f'"{name}"' in PAGE, name
    for topic in (FRAMES, KEYFRAMES, CONTRACTS, f"{VERDICTS}ACTUATOR", f"{REQUESTS}ACTUATOR"):
        assert f"`{topic}`" in PAGE
