"""The parser's tables are kept for the next process, in a folder that no other user can write to."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import lark
import lark.lark
import pytest

from colony.dsl import ast, parser


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The user's cache folder, in which there is nothing, as a new process sees it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    parser._parser.cache_clear()
    yield tmp_path / "colony"
    parser._parser.cache_clear()


def _reads() -> bool:
    return isinstance(parser.parse_from("let a = 3", 0), ast.File)


def test_tables_of_an_earlier_process_are_used(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert _reads()
    assert (cache.stat().st_mode & 0o777, os.listdir(cache)) == (0o700, ["grammar"])
    monkeypatch.delattr(lark.lark, "load_grammar")
    parser._parser.cache_clear()
    assert _reads()


@pytest.mark.parametrize("kept", [slice(0), slice(5_000), slice(40, None)], ids=["empty", "half", "unsealed"])
def test_damaged_tables_are_replaced(cache: Path, kept: slice) -> None:
    assert _reads()
    whole = (cache / "grammar").read_bytes()
    (cache / "grammar").write_bytes(whole[kept])
    parser._parser.cache_clear()
    assert _reads()
    assert (cache / "grammar").stat().st_size > len(whole) / 2


def test_tables_of_another_lark_are_replaced(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert _reads()
    first = (cache / "grammar").read_bytes()
    monkeypatch.setattr(lark, "__version__", "1.0")
    parser._parser.cache_clear()
    assert _reads()
    assert (cache / "grammar").read_bytes() != first


def test_without_a_place_for_them_the_tables_are_made(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    assert _reads()
    assert not cache.exists()


@pytest.mark.parametrize("mode", [0o777, 0o702, 0o770])
def test_a_folder_that_others_can_write_to_is_not_used(
    cache: Path, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    assert _reads()
    before = (cache / "grammar").stat().st_ino
    cache.chmod(mode)
    monkeypatch.setattr(lark.Lark, "load", None)
    parser._parser.cache_clear()
    assert _reads()
    assert (cache / "grammar").stat().st_ino == before


def test_unexpected_input_at_the_end_is_behind_the_last_word() -> None:
    found = parser.parse_from("let a =  # what\n", 0)
    assert isinstance(found, parser.Unexpected)
    assert (found.offset, found.at_end) == (7, True)


def test_a_refused_word_hides_nothing_that_was_allowed() -> None:
    """The parser reduces `a` to an expression when it reads the brace, before it refuses it."""
    found = parser.parse_from("module m { when a }", 0)
    refused = parser.parse_from("network { x = a ? }", 0)
    assert isinstance(found, ast.File)
    assert isinstance(refused, parser.Unexpected)
    assert refused.offset == 16
    assert {"DOT", "SUPPRESSES", "RBRACE", "NAME"} <= refused.accepted
