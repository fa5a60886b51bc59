"""Case files: each line of `cases/*.colony` tells in a comment what is found there.

`# E101 at 9, E202 at 14` expects those errors in that line, at those columns; nothing else may be found.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from colony.dsl.load import check_file
from colony.text.diagnostics import render

CASES = sorted((Path(__file__).parent / "cases").glob("*.colony"))
_EXPECTED = re.compile(r"([ENW]\d{3}) at (\d+)")


def expected(text: str) -> list[tuple[int, int, str]]:
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        _, _, comment = line.partition("#")
        found += [(number, int(column), code) for code, column in _EXPECTED.findall(comment)]
    return found


@pytest.mark.parametrize("path", CASES, ids=lambda p: p.stem)
def test_case(path: Path) -> None:
    checked = check_file(path)
    found = [(*d.span.source.position(d.span.start), d.code) for d in checked.diagnostics]
    shown = "\n".join(render(d) for d in checked.diagnostics)
    assert sorted(found) == sorted(expected(path.read_text())), shown


def test_there_are_cases() -> None:
    assert len(CASES) > 5
