"""The codes, the sources that use them and docs/errors.md agree; every example prints what the page shows."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Container
from pathlib import Path
from typing import NamedTuple

import pytest

import colony.dsl
from colony.dsl.descriptions import RobotChoice
from colony.dsl.errors import CODES
from colony.dsl.load import check_file
from colony.dsl.site_reading import read_params
from colony.text.diagnostics import Diagnostic, render
from tests.paths import ROOT

SOURCES = Path(colony.dsl.__file__).parent
PAGE = ROOT / "docs" / "errors.md"


class Fence(NamedTuple):
    """A block of the page: what stands after the backquotes, the text, and the code of its section."""

    info: str
    text: str
    code: str


def fences() -> list[Fence]:
    found, code, info, lines = [], "", None, []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("```"):
            if info is not None:
                found.append(Fence(info, "".join(lines), code))
            info, lines = (line[3:], []) if info is None else (None, [])
        elif info is not None:
            lines.append(f"{line}\n")
        elif line.startswith("### "):
            code = line[4:8]
    return found


def examples(codes: Container[str]) -> list[tuple[str, list[Fence], str]]:
    """Of each example of `codes` its code, the blocks that make its files, and what is printed."""
    found, files = [], list[Fence]()
    for fence in fences():
        if fence.code not in codes:
            continue
        if fence.info == "text":
            found.append((fence.code, files, fence.text))
            files = []
        else:
            files.append(fence)
    return found


[ROBOT] = [f.text for f in fences() if f.info == "colony robot"]


def make(files: list[Fence]) -> None:
    """Write the example's files into the current folder."""
    for fence in files:
        if fence.info == "sh":
            commands = fence.text.splitlines()
            assert commands.pop().startswith("colony check example.colony")
            subprocess.run("\n".join(commands), shell=True, check=True)
            continue
        _, _, name = fence.info.partition(" ")
        if name.endswith((".colony", ".toml")):
            Path(name).write_text(fence.text)
        else:
            alone = name == "alone" or fence.text.startswith("robot r ")
            Path("example.colony").write_text(fence.text + ("" if alone else ROBOT))


def checked(files: list[Fence]) -> tuple[Diagnostic, ...]:
    make(files)
    return checked_again(files)


def checked_again(files: list[Fence]) -> tuple[Diagnostic, ...]:
    """Check an example whose files have been made, as its command does."""
    [text] = re.findall(r" --robot (\S+)$", files[-1].text) or [None]
    robot = None if text is None else RobotChoice(text=text, origin=f"--robot {text}")
    [site] = re.findall(r" --params (\S+)$", files[-1].text) or [None]
    params = None if site is None else read_params(site)
    return check_file("example.colony", robot=robot, params=params).diagnostics


def test_every_code_of_the_sources_is_registered_and_none_besides() -> None:
    used: set[str] = set()
    for path in SOURCES.rglob("*.py"):
        if path.name != "errors.py":
            used |= set(re.findall(r'"([ENUW]\d{3})"', path.read_text()))
    assert used == set(CODES)


def test_codes_are_in_order() -> None:
    assert list(CODES) == sorted(CODES)


def test_the_page_has_a_section_for_every_code_in_order() -> None:
    headings = re.findall(r"^### ([ENUW]\d{3}): (.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert headings == list(CODES.items())


def test_every_code_has_an_example() -> None:
    assert {code for code, _, _ in examples(CODES)} == set(CODES)


@pytest.mark.parametrize(
    ("code", "files", "shown"),
    examples([code for code in CODES if code[0] in "EW"]),
    ids=lambda v: v if isinstance(v, str) and len(v) == 4 else "",
)
def test_an_example_prints_what_the_page_shows(
    code: str, files: list[Fence], shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = checked(files)
    if code == "E007":  # the errors before it are what makes it
        found = found[-1:]
    elif code.startswith("E"):
        found = tuple(d for d in found if d.severity == "error")
    assert {d.code for d in found} == {code}
    assert shown == render(found[0]) + "\n"
