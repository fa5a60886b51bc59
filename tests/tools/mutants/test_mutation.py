"""Mutants: all of them are found, each differs in one place, and each has a name of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mutmut", reason="`make mutants` needs it")

from tools.mutants.mutation import mutants_of

TEXT = '''"""A module."""

TABLE = {"a": 1}


class Shop:
    """Sells."""

    price = 3

    @property
    def double(self) -> int:
        return self.price * 2

    def dear(self, limit: int = 5) -> bool:
        return self.price > limit and self.price > limit
'''


def test_every_place_is_mutated(tmp_path: Path) -> None:
    (tmp_path / "shop.py").write_text(TEXT)
    mutants = mutants_of(tmp_path, "shop.py")
    found = {(m.place, m.now) for m in mutants}
    assert ("module", 'TABLE = {"a": 2}') in found
    assert ("Shop", "price = 4") in found
    assert ("Shop.double", "return self.price / 2") in found
    assert ("Shop.double", "return self.price * 3") in found
    assert ("Shop.dear", "def dear(self, limit: int = 6) -> bool:") in found
    assert ("Shop.dear", "return self.price >= limit and self.price > limit") in found
    assert len({m.key for m in mutants}) == len(mutants)
    for mutant in mutants:
        old, new = TEXT.splitlines(), mutant.source.splitlines()
        assert [line for line in new if line not in old] == [f"{_indent(mutant.now, new)}{mutant.now}"]
        assert old[mutant.line - 1].strip() == mutant.was


def test_a_case_is_left_out(tmp_path: Path) -> None:
    cases = "        case 1:\n            return 2\n        case _:\n            return 3\n"
    text = f"def f(x):\n    match x:\n{cases}"
    (tmp_path / "f.py").write_text(text)
    assert ("case 1: return 2", "") in {(m.was, m.now) for m in mutants_of(tmp_path, "f.py")}


def test_the_same_change_in_two_places_has_two_names(tmp_path: Path) -> None:
    (tmp_path / "f.py").write_text("def f(x):\n    x += 1\n    x += 1\n    return x\n")
    keys = [m.key for m in mutants_of(tmp_path, "f.py") if m.now == "x -= 1"]
    assert keys == ["f: x += 1 => x -= 1", "f: x += 1 => x -= 1 #2"]


def _indent(line: str, lines: list[str]) -> str:
    (found,) = {whole[: -len(line)] for whole in lines if whole.strip() == line}
    return found
