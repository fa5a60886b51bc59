"""Command lines that are run in this process, as the console script runs them."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest


class Ran(NamedTuple):
    """What a command left behind."""

    code: int
    out: str
    err: str


class Command:
    """Runs a command with arguments; `stdin` is what it reads there."""

    def __init__(
        self,
        main: Callable[[], object],
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        self._main, self._monkeypatch, self._capsys = main, monkeypatch, capsys

    def __call__(self, *arguments: str | Path, stdin: str = "") -> Ran:
        self._monkeypatch.setattr(sys, "argv", ["colony", *map(str, arguments)])
        self._monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin.encode())))
        with pytest.raises(SystemExit) as stopped:
            self._main()
        captured = self._capsys.readouterr()
        assert isinstance(stopped.value.code, int)
        assert "Traceback" not in captured.err
        return Ran(stopped.value.code, captured.out, captured.err)

    def output(self, *arguments: str | Path, stdin: str = "") -> str:
        """Run it with arguments that succeed; return what it prints."""
        code, out, err = self(*arguments, stdin=stdin)
        assert code == 0, out + err
        return out

    def refusal(self, *arguments: str | Path, code: int = 2, stdin: str = "") -> str:
        """Run it with arguments that it refuses, printing nothing; return its messages."""
        ran = self(*arguments, stdin=stdin)
        assert (ran.code, ran.out) == (code, ""), ran.err
        return ran.err

    def one_line(self, *arguments: str | Path, code: int = 2, stdin: str = "") -> str:
        """Run it with arguments that it refuses in one line; return the line."""
        err = self.refusal(*arguments, code=code, stdin=stdin)
        assert err.count("\n") == 1, err
        return err
