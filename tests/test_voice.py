"""How the code reads: two counts that only go down (CONTRIBUTING.md, "How the code looks")."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from tests.paths import ROOT

LOOSE = re.compile(r"(Of|How|For|By|To|What|Who|Whether|Where|When)\b")
"""Beginning of a docstring that does not name its thing."""

WORDS = re.compile(r"\b(told|tells|anew|whoever|who (?:is|was|dies|has|waits))\b", re.IGNORECASE)
"""Words for which there are plainer ones."""

MOST_LOOSE = 0.05
"""Largest part of the docstrings of attributes and constants that begin loosely."""

MOST_WORDS = 5
"""Largest number of `WORDS` in all of colony/. Lower it when there are fewer."""

SOURCES = sorted((ROOT / "colony").rglob("*.py"))


def _docstrings(path: Path) -> Iterator[str]:
    """Yield the docstrings of the attributes and constants of a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        for declared, following in pairwise(body):
            match declared, following:
                case ast.Assign() | ast.AnnAssign(), ast.Expr(value=ast.Constant(value=str(text))):
                    yield text


def test_docstrings_of_attributes_name_their_things() -> None:
    found = [text for path in SOURCES for text in _docstrings(path)]
    loose = [text for text in found if LOOSE.match(text)]
    assert len(loose) <= MOST_LOOSE * len(found), f"{len(loose)} of {len(found)}: {loose[:5]}"


def test_there_are_plainer_words() -> None:
    count = sum(len(WORDS.findall(path.read_text(encoding="utf-8"))) for path in SOURCES)
    assert count <= MOST_WORDS, f"{count} of told, tells, anew, whoever, who is, ...; at most {MOST_WORDS}"
    assert count > MOST_WORDS - 20, f"there are only {count}: lower MOST_WORDS"
