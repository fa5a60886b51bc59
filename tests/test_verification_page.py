"""docs/verification.md: its commands print what is shown below them, its files are those that they work on.

`python -m tests.test_verification_page` writes the output of the commands anew.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from colony.text.codes import CODES
from tests.pages import COMMANDS, typed
from tests.paths import ROOT

FILE = ROOT / "docs" / "verification.md"
PAGE = FILE.read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```\w+ (\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def page(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The page with what the commands print, run one after the other in an empty folder."""
    shutil.copytree(ROOT / "behaviors", folder / "behaviors")
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(folder)

    def run(block: re.Match[str]) -> str:
        printed = [typed(line, monkeypatch, errors=True) for line in block[1].splitlines()]
        return f"```sh\n{block[1]}```\n\n```text\n{printed[-1]}```"

    return COMMANDS.sub(run, PAGE)


@pytest.mark.long
def test_commands_print_what_the_page_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert page(tmp_path, monkeypatch) == PAGE, "`python -m tests.test_verification_page` writes it anew"


def test_the_property_holds(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "behaviors", tmp_path / "behaviors")
    (tmp_path / "test_steady.py").write_text(FILES["test_steady.py"], encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_steady.py"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "CI": "1"}  # to hypothesis: no deadlines
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_every_lint_is_told_of() -> None:
    for code in CODES:
        if "V020" <= code < "V040":
            assert code in PAGE


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        text = page(Path(folder), patch)
    FILE.write_text(text, encoding="utf-8")
