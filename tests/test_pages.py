"""All pages: links lead somewhere, also within a page, and every block is of the language that it names."""

from __future__ import annotations

import ast
import doctest
import importlib
import json
import re
import shlex
import tomllib
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import click
import pytest
import yaml

from colony.cli.main import colony as cli
from colony.dsl.parse import parse
from colony.text.source import Source
from tests.paths import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        file, _, anchor = target.partition("#")
        if ":" not in file:
            leads_to = page.parent / file if file else page
            assert leads_to.exists(), target
            assert not anchor or anchor in _anchors(leads_to), target


def _anchors(page: Path) -> set[str]:
    """The names of its headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


FOLDERS = [ROOT, ROOT / "colony", *(path for path in (ROOT / "colony").rglob("*") if path.is_dir())]
"""Folders in which paths in the text of a page begin."""


@pytest.mark.parametrize("page", ["ARCHITECTURE.md", "CONTRIBUTING.md"])
def test_paths_in_the_text_are_there(page: str) -> None:
    paths = re.findall(r"`([a-z_]+/[\w./]*)`", (ROOT / page).read_text(encoding="utf-8"))
    assert len(paths) > 2
    lost = [path for path in paths if not any((folder / path).exists() for folder in FOLDERS)]
    assert not [path for path in lost if "NAME" not in path]


# --- blocks ------------------------------------------------------------------------------------------


class Block(NamedTuple):
    """A fenced block: its page and line, the words after the backquotes, and its text."""

    place: str
    info: str
    text: str


def blocks() -> list[Block]:
    """Every block of every page, without the indentation of a list around it."""
    found = []
    for page in PAGES:
        lines, info, begun = list[str](), None, 0
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
            if line.lstrip().startswith("```"):
                if info is not None:
                    found.append(Block(f"{page.name}:{begun}", info, "\n".join(lines) + "\n"))
                info, begun, lines = (line.strip()[3:], number, []) if info is None else (None, 0, [])
            elif info is not None:
                lines.append(line)
    return found


NOT_READ = {
    "text": "what a command prints, or a form",
    "stickrep": "maps; tests/nav/maps and tests/test_map_page.py read them",
    "nft": "rules of a firewall; tests/runtime/transport/live loads them where nft is installed",
}
"""The kinds of blocks that are not read here, each with the reason."""


@pytest.mark.parametrize("block", blocks(), ids=lambda block: block.place)
def test_a_block_is_of_its_language(block: Block) -> None:
    kind, _, rest = block.info.partition(" ")
    match kind:
        case "colony" | "toml" | "json" if block.place.startswith("errors.md"):
            pass  # wrong on purpose; the tests of that page compare the errors
        case "colony":
            found = [d.code for d in parse(Source("page", block.text)).diagnostics]
            assert not [code for code in found if code != rest.removeprefix("wrong ")]
        case "python":
            _python(block.text)
        case "toml":
            tomllib.loads(block.text)
        case "yaml":
            yaml.safe_load(block.text)
        case "json":
            for row in block.text.splitlines() if block.text.startswith('{"') else [block.text]:
                json.loads(row)
        case "sh":
            for line in block.text.replace("\\\n", " ").splitlines():
                _shell(line)
        case _:
            assert kind in NOT_READ, f"```{block.info}: name its language"


def _python(text: str) -> None:
    """Compile a block, or its doctests, and find every name that it imports from colony."""
    if text.startswith(">>>"):
        text = "".join(example.source for example in doctest.DocTestParser().get_examples(text))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "colony":
            module = importlib.import_module(str(node.module))
            for alias in node.names:
                assert hasattr(module, alias.name) or find_spec(f"{node.module}.{alias.name}"), alias.name


def _shell(line: str) -> None:
    """Look for the commands of colony with their options, modules of Python and targets of make in a line."""
    words = shlex.split(line, comments=True)
    for i, word in enumerate(words):
        following = words[i + 1 :]
        if word == "colony" and (i == 0 or words[i - 1] in ("|", "&&", "||", ";", "&", "-c", "--")):
            _colony(following)
        elif word == "make" and i == 0:
            targets = (ROOT / "Makefile").read_text(encoding="utf-8")
            for target in (w for w in following if re.fullmatch(r"[a-z-]+", w)):
                assert f"\n{target}:" in targets, target
        elif words[i - 1 : i] == ["-m"] and words[i - 2 : i - 1] in (["python"], ["python3"]):
            top = word.split(".")[0]
            assert top not in ("colony", "benchmarks", "tests") or find_spec(word), word


def _colony(words: list[str]) -> None:
    """Hold the options of a command to those that it has."""
    command: click.Command = cli
    for word in words:
        if word in ("|", "&&", "||", ";", "&", ">", "2>", "<"):
            break
        if isinstance(command, click.Group) and not word.startswith("-"):
            found = command.get_command(click.Context(command), word)
            assert found is not None, f"no command `{word}`"
            command = found
        elif word.startswith("--"):
            options = {name for p in command.params for name in (*p.opts, *p.secondary_opts)} | {"--help"}
            assert word.partition("=")[0] in options, f"`{command.name}` has no option {word}"
