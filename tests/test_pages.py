"""All pages: links lead somewhere; every block is of the language that it names, and runs as it says."""

from __future__ import annotations

import ast
import doctest
import importlib
import json
import re
import shlex
import tomllib
from configparser import ConfigParser
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import click
import pytest
import yaml

from colony.cli.main import colony as cli
from colony.dsl.parse import parse
from colony.text.source import Source
from tests.pages import (
    NOT_RUN,
    PAGES,
    TESTED_APART,
    Block,
    Runner,
    blocks,
    is_same_picture,
    not_run,
    page_text,
    runnable,
)
from tests.paths import ROOT

BLOCKS = [block for page in PAGES for block in blocks(page)]
SLOW = ("experiments.md", "explain.md", "recordings.md", "robots.md", "verification.md", "your-robot.md")


@pytest.mark.parametrize("page", PAGES.values(), ids=PAGES)
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


NOT_READ = {
    "c": "C; tests/compile/backends/c/test_targets.py compiles it",
    "text": "what a command prints, or a form",
    "stickrep": "maps; tests/page_facts/test_maps.py reads them",
    "nft": "rules of a firewall; tests/runtime/transport/live loads them where nft is installed",
}
"""The kinds of blocks that are not read here, each with the reason."""


@pytest.mark.parametrize("block", BLOCKS, ids=str)
def test_a_block_is_of_its_language(block: Block) -> None:
    kind, _, rest = block.info.partition(" ")
    match kind:
        case "colony" | "toml" | "json" if block.page == "errors.md":
            pass  # wrong on purpose; the tests of that page compare the errors
        case "colony":
            found = [d.code for d in parse(Source("page", block.text)).diagnostics]
            assert not [code for code in found if code != rest.removeprefix("wrong ")]
        case "python":
            _python(block.text)
        case "toml":
            tomllib.loads(block.text)
        case "xml":
            ElementTree.fromstring(block.text)
        case "yaml":
            yaml.safe_load(block.text)
        case "ini":
            ConfigParser(interpolation=None).read_string(block.text)
        case "json":
            for row in block.text.splitlines() if block.text.startswith('{"') else [block.text]:
                json.loads(row)
        case "sh":
            for line in block.commands:
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
            assert top not in ("colony", "benchmarks", "studies", "tests", "tools") or find_spec(word), word


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


# --- running them ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=[pytest.mark.long] * (p in SLOW)) for p in PAGES if runnable(p)],
)
def test_the_blocks_do_what_the_page_says(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runner = Runner(page, monkeypatch)
    wrong = dict[str, str]()
    for block in runnable(page):
        try:
            runner.run(block)
        except Exception as raised:
            wrong[str(block)] = f"{type(raised).__name__}: {raised}"
    assert not wrong, "\n\n".join(f"{place}: {what}" for place, what in wrong.items())
    for block, printed in runner.printed.items():
        assert printed == block.shown, f"{block}: `python -m tests.pages docs/{page}` writes it again"
    for name in re.findall(r"!\[[^]]*\]\((\w+\.svg)\)", page_text(page)):
        if Path(name).exists():
            assert is_same_picture(Path(name), ROOT / "docs" / name), name


def test_what_is_not_run_is_on_a_page() -> None:
    texts = [line for b in BLOCKS for line in (b.commands if b.info.startswith("sh") else [b.text])]
    assert {pattern for text in texts for pattern in not_run(text)} == set(NOT_RUN)
    assert set(TESTED_APART) <= set(PAGES)
