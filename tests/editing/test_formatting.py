"""The one style: tokens and comments stay, nothing changes twice, and all files of the project are in it."""

from __future__ import annotations

import random
import re
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.dsl.parse import parse, parse_with_tokens
from colony.editing.formatting import formatted
from colony.text.diagnostics import DiagnosticError
from colony.text.source import Source
from tests.case_files import Case, cases
from tests.drawn.strategies import texts
from tests.paths import ROOT

_FILES = [
    path
    for path in sorted(ROOT.rglob("*.colony"))
    if not {".venv", "build"} & set(path.relative_to(ROOT).parts)
    and not path.is_relative_to(ROOT / "tests" / "dsl" / "cases")
]
"""All but the cases of errors: their comments name columns."""


_BETWEEN = (" ", " ", " ", "   ", "\n", "\n    ", "\n\n\n", " # note\n", "\n  # a\n\n# b\n", "\t", "\r\n")


def spread(text: str, seed: int) -> str:
    """Return the tokens of a text with other blanks, line breaks and comments between them."""
    choices = random.Random(seed)
    _, tokens = parse_with_tokens(Source("<text>", text))
    return "".join(f"{token}{choices.choice(_BETWEEN)}" for token in tokens)


def assert_formatted(text: str) -> str:
    """Format a text, and return it; assert that it is the same program with the same comments."""
    result = formatted(text, "<text>")
    again, before = (parse(Source("<text>", each)) for each in (result, text))
    assert again.file == before.file
    assert "".join(result.split()) == "".join(text.split())
    assert comments_of(result) == comments_of(text)
    assert formatted(result, "<text>") == result
    lines = result.split("\n")
    assert not any(line != line.rstrip() or "\t" in line for line in lines)
    assert "\n\n\n" not in result
    return result


def comments_of(text: str) -> list[str]:
    return [comment.rstrip() for comment in re.findall("#[^\r\n]*", text)]


@given(texts(), st.integers(0, 1000))
def test_a_drawn_program_stays_the_same_however_it_is_spread(text: str, seed: int) -> None:
    assert_formatted(text)
    assert_formatted(spread(text, seed))


@pytest.mark.parametrize("path", _FILES, ids=lambda p: p.stem)
def test_and_so_does_a_file_of_the_project(path: Path) -> None:
    assert_formatted(spread(path.read_text(encoding="utf-8"), 1))


def test_the_files_of_the_project_are_in_the_style() -> None:
    assert len(_FILES) > 30
    for path in _FILES:
        text = path.read_text(encoding="utf-8")
        assert formatted(text, str(path)) == text, f"colony fmt {path.relative_to(ROOT)}"


_BLOCK = re.compile(r"^( *)```colony[^\n]*\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
_SYNTAX_ERRORS = {"E005", "E006", "E007"}
"""Codes of errors.md with examples that cannot be read."""


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))], ids=lambda p: p.name
)
def test_the_blocks_of_the_pages_are_in_the_style(page: Path) -> None:
    for _, block in _BLOCK.findall(page.read_text(encoding="utf-8")):
        text = textwrap.dedent(block)
        errors = {d.code for d in parse(Source(page.name, text)).diagnostics}
        if errors and page.name == "errors.md":
            assert errors <= _SYNTAX_ERRORS
        elif not text.startswith("language 3\n"):
            assert formatted(text, page.name) == text


def test_a_file_with_syntax_errors_is_refused_with_all_of_them() -> None:
    with pytest.raises(DiagnosticError) as refused:
        formatted("let a = \nlet b = 3 +\nlet c = 1\n", "a.colony")
    assert [d.code for d in refused.value.diagnostics] == ["E005", "E005"]
    with pytest.raises(DiagnosticError, match="E008"):
        formatted("language 7\n", "a.colony")


def test_a_file_of_two_thousand_lines_takes_no_longer_than_four_times_its_parse() -> None:
    text = (ROOT / "behaviors" / "hallway.colony").read_text(encoding="utf-8")
    head, body = text.split("language 1\n")
    long = f"{head}language 1\n{body * 7}"
    assert long.count("\n") > 1900

    def seconds(function: Callable[[str, str], object]) -> float:
        begin = time.process_time()
        function(long, "a.colony")
        return time.process_time() - begin

    def parsed(text: str, path: str) -> object:
        return parse(Source(path, text))

    assert min(seconds(formatted) for _ in range(3)) < 4 * min(seconds(parsed) for _ in range(3))


@pytest.mark.parametrize("case", cases(Path(__file__).parent / "cases" / "formatting.txt"))
def test_case(case: Case) -> None:
    case.check(assert_formatted(case.given))
