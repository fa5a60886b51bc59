"""The command of the studies is run in this process."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from studies.command import command
from tests.commands import Command

Studies = Command


@pytest.fixture
def studies(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Studies:
    """Run `python -m studies ARGUMENTS` in an empty directory."""
    monkeypatch.chdir(tmp_path)
    return Command(partial(command, prog_name="python -m studies"), monkeypatch, capsys)
