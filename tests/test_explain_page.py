"""docs/explain.md: its commands print what is shown below them.

`python -m tests.test_explain_page` writes the output of the commands again.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import pytest

from colony.robots.moments.finding import CONDITIONS
from tests.pages import COMMANDS, typed
from tests.paths import ROOT

FILE = ROOT / "docs" / "explain.md"
PAGE = FILE.read_text(encoding="utf-8")


def page(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the page with what the commands print, run one after the other in an empty folder."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))

    def run(block: re.Match[str]) -> str:
        printed = [typed(line, monkeypatch) for line in block[1].splitlines()]
        return f"```sh\n{block[1]}```\n\n```text\n{printed[-1]}```"

    return COMMANDS.sub(run, PAGE)


@pytest.mark.long
def test_commands_print_what_the_page_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert page(tmp_path, monkeypatch) == PAGE, "`python -m tests.test_explain_page` writes it again"


def test_every_condition_is_on_the_page() -> None:
    for word in CONDITIONS:
        assert f"is {word}`" in PAGE, word


def main() -> None:
    """Write the page with what its commands print."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as monkeypatch:
        FILE.write_text(page(Path(folder), monkeypatch), encoding="utf-8")


if __name__ == "__main__":
    main()
