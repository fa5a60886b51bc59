"""docs/language.md: every example is checked, its tests are run, and the tables leave nothing out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from colony.dsl.check.calls import FUNCTION_NAMES
from colony.dsl.load import check_file
from colony.dsl.syntax_hints import RESERVED
from colony.text.diagnostics import headline
from colony.text.units import BASE_UNITS
from colony.verify.testing.examples import failures_as_diagnostics, run_examples
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "language.md").read_text(encoding="utf-8")
FENCES = re.findall(r"^```colony ?([^\n]*)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
[ROBOT] = [text for info, text in FENCES if info == "robot"]
FILES = {info: text for info, text in FENCES if info.endswith(".colony")}
EXAMPLES = [(info, text) for info, text in FENCES if info not in FILES and info != "robot"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The files that examples import."""
    (tmp_path / "rome.colony").write_text(ROBOT)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def check(text: str, folder: Path) -> list[str]:
    """The headlines of all errors, and of the failures of all tests."""
    path = folder / "example.colony"
    robot = "" if re.search(r"^(robot|language) ", text, re.MULTILINE) else 'import "rome.colony"\n'
    path.write_text(robot + text)
    checked = check_file(path)
    errors = [headline(d) for d in checked.diagnostics if d.severity == "error"]
    if checked.program is None or any("from python" in line for line in text.splitlines()):
        return errors
    return [headline(d) for d in failures_as_diagnostics(run_examples(checked.program))]


@pytest.mark.parametrize(("info", "text"), EXAMPLES, ids=[text.splitlines()[0][:40] for _, text in EXAMPLES])
def test_an_example(info: str, text: str, folder: Path) -> None:
    found = check(text, folder)
    if info.startswith("wrong "):
        assert len(found) == 1
        assert info.removeprefix("wrong ") in found[0]
    else:
        assert info == ""
        assert found == []


def test_the_robot_and_the_files_are_good(folder: Path) -> None:
    assert check(ROBOT, folder) == []
    for text in FILES.values():
        assert check(text.replace('import "rome.colony"\n', ""), folder) == []


def test_the_tables_name_every_function() -> None:
    rows = "\n".join(line.split("|")[1] for line in PAGE.splitlines() if line.startswith("| `"))
    for name in FUNCTION_NAMES:
        assert re.search(rf"`{name}\b", rows), name


def test_every_unit_and_reserved_word_is_named() -> None:
    for name in BASE_UNITS:
        assert f"`{name}`" in PAGE, name
    [listed] = re.findall(r"operator words are reserved: `([^`]*)`", PAGE)
    assert set(listed.split()) == RESERVED


def test_links_lead_somewhere() -> None:
    anchors = {
        re.sub(r"[^a-z0-9 -]", "", heading.lower()).replace(" ", "-")
        for heading in re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)
    }
    for anchor in re.findall(r"\]\(#([^)]*)\)", PAGE):
        assert anchor in anchors
