"""The codes besides the front end's: sources, registry and docs/errors.md agree, and so do the examples."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from colony.dsl.errors import CODES as FRONT_END_CODES
from colony.runtime.kit.connection import connect
from colony.runtime.kit.errors import ServerNotFoundError
from colony.text.codes import CODES
from tests.dsl.test_error_page import PAGE, ROBOT, Fence, examples
from tests.pages import typed
from tests.paths import ROOT
from tests.waiting import killed_in_the_end, until

SOURCES = ROOT / "colony"
EXIT_CODES = {"M": 2, "F": 2, "R": 1, "B": 1, "X": 1, "P": 1, "T": 1, "C": 2, "A": 2, "V": 1}
"""What the page says at the beginning of each part; where there are only warnings it is 0."""
MISUSE = {"V040", "V041", "V042", "B001"}
"""What keeps behaviors from being compared at all, or a file from being read."""
RETIRED = {"B012"}
"""Codes that nothing reports any more; no other finding gets them."""
PARTLY = {"A006"}
"""What is found rather than misused."""


def sources() -> dict[Path, str]:
    """Everything outside of the front end that may report."""
    return {
        path: path.read_text(encoding="utf-8")
        for path in SOURCES.rglob("*.py")
        if "dsl" not in path.relative_to(SOURCES).parts and path != SOURCES / "text/codes.py"
    }


def test_every_code_of_the_sources_is_registered_and_none_besides() -> None:
    used: set[str] = set()  # E and W are the front end's, A323 is a room
    for text in sources().values():
        used |= set(re.findall(r'"([A-DF-VX-Z]0(?!00)\d{2})"', text))
        used |= set(re.findall(r"error\[([A-DF-VX-Z]0(?!00)\d{2})\]", text))
    assert used == set(CODES)


def test_comments_tell_of_no_other_codes() -> None:
    for path, text in sources().items():
        assert set(re.findall(r"\b[ACFMPRTV]0(?!00)\d{2}\b", text)) <= set(CODES), path


def test_the_page_has_a_section_for_every_code_in_order() -> None:
    headings = re.findall(r"^### ([^ENUW]\d{3}): (.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert headings == list(CODES.items())


def test_codes_of_a_part_are_in_order() -> None:
    for part in EXIT_CODES:
        codes = [code for code in CODES if code.startswith(part)]
        assert codes == sorted(codes)
        if part != "V":  # there each kind of proof has numbers of its own
            numbered = [f"{part}{i:03}" for i in range(1, len(codes) + len(RETIRED) + 1)]
            assert codes == [code for code in numbered if code not in RETIRED][: len(codes)]
            assert not RETIRED & set(codes)


def test_every_code_has_an_example() -> None:
    assert list(dict.fromkeys(code for code, _, _ in examples(CODES))) == list(CODES)


def make(files: list[Fence]) -> str:
    """Write the example's files into the current folder, and return the command to type."""
    shutil.copytree(ROOT / "maps", "maps")
    for name in ("example.colony", "rome.colony"):
        Path(name).write_text("".join(ROBOT))
    command = ""
    for fence in files:
        match fence.info.split():
            case ["sh", "server"]:
                pass
            case ["sh"]:
                *commands, command = fence.text.splitlines()
                subprocess.run("\n".join(commands), shell=True, check=True)
            case ["stickrep"]:
                Path("example.stickrep").write_text(fence.text)
            case ["json"]:
                Path("frames.jsonl").write_text(fence.text)
            case ["python" | "toml", name]:
                Path(name).write_text(fence.text)
            case ["colony", *words]:
                alone = words == ["alone"] or fence.text.startswith(("robot ", "import "))
                Path("example.colony").write_text(fence.text + ("" if alone else "".join(ROBOT)))
                if words == [] and fence.text.startswith("robot rome"):  # beside its body, rome.toml
                    shutil.copy("example.colony", "rome.colony")
            case other:
                raise AssertionError(f"{fence.code} has an unknown block: {other}")
    return command


def answers(server: str) -> bool:
    try:
        connect(server, robot="rome").close()
    except ServerNotFoundError:
        return False
    return True


@contextmanager
def serving(files: list[Fence]) -> Iterator[None]:
    """The server that an example has in another terminal, if it has one."""
    with ExitStack() as ended:
        for fence in files:
            if fence.info == "sh server":
                environment = {**os.environ, "PYTHONPATH": str(ROOT)}
                server = subprocess.Popen([sys.executable, *fence.text.split()[1:]], env=environment)
                ended.enter_context(killed_in_the_end(server))
                [name] = re.findall(r'Server.open\("(\w+)"', "".join(f.text for f in files))
                until(lambda name=name: answers(name), "the server is there")  # type: ignore[misc]
        yield


@pytest.mark.parametrize(
    ("code", "files", "shown"),
    examples([*CODES, *(code for code in FRONT_END_CODES if code[0] == "N")]),
    ids=lambda v: v if isinstance(v, str) and len(v) == 4 else "",
)
def test_an_example_prints_what_the_page_shows(
    code: str, files: list[Fence], shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = make(files)
    with serving(files):
        stopped, _, printed = typed(command, monkeypatch)
    assert printed == shown
    errors, warnings = (
        set(re.findall(rf"(?:{kinds})\[(\w+)\]", printed)) for kinds in ("error", "warning|note")
    )
    assert errors == {code} or (not errors and warnings == {code})
    assert stopped == (1 if code in PARTLY else 2 if code in MISUSE else EXIT_CODES[code[0]] if errors else 0)


@pytest.mark.parametrize("backend", ["network", "clients", "python"])
def test_a_class_that_cannot_be_built_is_told_by_every_executor(
    backend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    [files] = [files for code, files, _ in examples(CODES) if code == "P001"]
    stopped, _, printed = typed(f"{make(files)} --backend {backend}", monkeypatch)
    assert stopped == 1
    assert "error[P001]: " in printed
    assert "cannot be imported and built: TypeError: " in printed
    assert "  hint: " in printed
