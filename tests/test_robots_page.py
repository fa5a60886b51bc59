"""docs/robots.md: its files check, and its commands print what the page shows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.body.keys_table import rows
from tests.pages import COMMANDS, typed
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "robots.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```(?:colony|toml) file=(\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def test_commands_print_what_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    for commands, shown in COMMANDS.findall(PAGE):
        printed = "".join(typed(command, monkeypatch, errors=True) for command in commands.splitlines())
        assert printed == shown
    assert typed("colony test wander --robot scout", monkeypatch).endswith("5 passed, 0 failed\n")


def test_the_page_has_every_key_of_a_body() -> None:
    assert "\n".join(rows()) in PAGE
