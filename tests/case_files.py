"""Files of cases: text in, text out, many of them in a file, for people to read.

A case is a line `== title`, what is given, a line `--`, and what is expected. With `UPDATE_CASES=1` in the
environment, tests write what they found in place of what was expected: run them without `-n`, read the diff.
A table has a line `given -> expected` for each case. In both, lines that begin with `#` are comments.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import pytest
from _pytest.mark import ParameterSet

_UPDATE = bool(os.environ.get("UPDATE_CASES"))


class Case(NamedTuple):
    """What a file gives, and what it expects of it."""

    path: Path
    title: str
    given: str
    expected: str

    def check(self, found: str) -> None:
        """Compare what was found with what is expected, or (UPDATE_CASES) write it down."""
        found = found.rstrip()
        if _UPDATE and found != self.expected:
            head = f"== {self.title}\n{self.given}\n--\n"
            old, new = (head + (f"{text}\n" if text else "") for text in (self.expected, found))
            text = self.path.read_text(encoding="utf-8")
            assert text.count(old) == 1
            self.path.write_text(text.replace(old, new), encoding="utf-8")
        else:
            assert found == self.expected


def cases(path: Path) -> list[ParameterSet]:
    """Return the cases of a file, or of all files in a folder, as parameters of a test."""
    if path.is_dir():
        return [one for file in sorted(path.glob("*.txt")) for one in cases(file)]
    _, *texts = ("\n" + path.read_text(encoding="utf-8")).split("\n== ")
    found = []
    for text in texts:
        title, _, rest = text.partition("\n")
        given, line, expected = f"{rest}\n".partition("\n--\n")
        assert line, f"{path.name}: {title}: no line `--`"
        found.append(pytest.param(Case(path, title, given, expected.rstrip()), id=f"{path.stem}: {title}"))
    return found


def table(path: Path) -> list[tuple[str, str]]:
    """Return the lines of a table: what is given, and what is expected."""
    lines = path.read_text(encoding="utf-8").splitlines()
    pairs = (line.rpartition(" -> ") for line in lines if line.strip() and not line.startswith("#"))
    return [(given.strip(), expected.strip()) for given, _, expected in pairs]
