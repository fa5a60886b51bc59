"""The command of the studies is run in this process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from studies.command import command


class Ran(NamedTuple):
    """What a command left behind."""

    code: int
    out: str
    err: str


Studies = Callable[..., Ran]


@pytest.fixture
def studies(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Studies:
    """Run `python -m studies ARGUMENTS` in an empty directory."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> Ran:
        with pytest.raises(SystemExit) as stopped:
            command(list(arguments), prog_name="python -m studies")
        captured = capsys.readouterr()
        assert isinstance(stopped.value.code, int)
        return Ran(stopped.value.code, captured.out, captured.err)

    return run
