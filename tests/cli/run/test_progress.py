"""Words for those who wait."""

from __future__ import annotations

import sys
import time

import pytest

from colony.cli.run.progress import told_if_slow


def test_slow_work_is_announced_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    heard = ""
    with told_if_slow("compiling", after_s=0.0):
        while not heard:
            time.sleep(0.001)
            heard = capsys.readouterr().err
    assert heard == "compiling\n"
    with told_if_slow("compiling", after_s=60.0):
        pass
    assert capsys.readouterr().err == ""


def test_nobody_is_told_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with told_if_slow("compiling", after_s=0.0):
        time.sleep(0.01)
    assert capsys.readouterr().err == ""
