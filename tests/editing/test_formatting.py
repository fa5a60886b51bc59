"""The one style: tokens and comments stay, nothing changes twice, and all files of the project are in it."""

from __future__ import annotations

import random
import re
import subprocess
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.dsl.parse import parse, parse_with_tokens
from colony.editing.formatting import formatted
from colony.text.diagnostics import DiagnosticError
from colony.text.source import Source
from tests.drawn.strategies import texts
from tests.paths import ROOT

_FILES = [
    path
    for path in sorted(ROOT.rglob("*.colony"))
    if not {"cases", ".venv", "build"} & set(path.relative_to(ROOT).parts)
]


_BETWEEN = (" ", " ", " ", "   ", "\n", "\n    ", "\n\n\n", " # note\n", "\n  # a\n\n# b\n", "\t", "\r\n")


def spread(text: str, seed: int) -> str:
    """Return the tokens of a text with other blanks, line breaks and comments between them."""
    choices = random.Random(seed)
    _, tokens = parse_with_tokens(Source("<text>", text))
    return "".join(f"{token}{choices.choice(_BETWEEN)}" for token in tokens)


def assert_formatted(text: str) -> str:
    """Format a text, assert that it is the same program with the same comments and that all is set; return it."""
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
