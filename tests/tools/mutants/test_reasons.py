"""The list of survivors is well formed, and says of each why it changes nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mutmut", reason="`make mutants` needs it")

from tools.mutants import reasons, scope
from tools.mutants.mutation import Mutant
from tools.mutants.scope import ROOT, modules


def mutant(was: str, now: str, path: str = "a.py") -> Mutant:
    return Mutant(path=path, place="f", line=1, was=was, now=now, nth=1, source="")


LISTED = """
[[everywhere]]
was = 'strict=True'
now = 'strict=False'
why = "Equally long."

[[survivor]]
path = "a.py"
why = "The same."
mutants = ["f: x => y"]
"""


def test_a_survivor_is_explained_by_its_name_or_by_its_kind(tmp_path: Path) -> None:
    (tmp_path / "listed.toml").write_text(LISTED)
    known = reasons.load(tmp_path / "listed.toml")
    assert known.why(mutant("x", "y")) == "The same."
    assert known.why(mutant("x", "y", "b.py")) is None
    assert known.why(mutant("zip(a, b, strict=True)", "zip(a, b, strict=False)", "b.py")) == "Equally long."
    assert list(known.stale([], [mutant("a", "b")])) == ["a.py: f: x => y"]
    assert list(known.stale([mutant("x", "y")], [mutant("x", "y")])) == []
    assert list(known.stale([], [mutant("a", "b", "b.py")])) == []


def test_what_is_listed_is_of_modules_that_are_mutated() -> None:
    known = reasons.load()
    assert {path for path, _ in known.of} <= set(modules())
    assert all((ROOT / path).exists() for path, _ in known.of)


def test_what_is_mutated_and_its_tests_are_there() -> None:
    paths = [*scope.modules(), *scope.tests()]
    assert [path for path in paths if not (scope.ROOT / path).is_file()] == []
