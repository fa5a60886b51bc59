"""The parser's tables are kept for the next process, in a folder that no other user can write to."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree

import lark
import lark.lark
import pytest

from colony.dsl import ast, parser
from tests.sampling import long


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A user's cache folder with the tables that a first process makes."""
    home = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(home))
        parser._parser.cache_clear()
        assert _reads()
    yield home
    parser._parser.cache_clear()


@pytest.fixture
def cache(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache folder, with tables in it, as a new process sees it."""
    copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    parser._parser.cache_clear()
    return tmp_path / "colony"


def _reads() -> bool:
    return isinstance(parser.parse_from("let a = 3", 0), ast.File)


def test_tables_of_an_earlier_process_are_used(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert (cache.stat().st_mode & 0o777, os.listdir(cache)) == (0o700, ["grammar"])
    monkeypatch.delattr(lark.lark, "load_grammar")
    assert _reads()


@pytest.mark.parametrize(
    "kept", [long(slice(0)), long(slice(5_000)), slice(40, None)], ids=["empty", "half", "unsealed"]
)
def test_damaged_tables_are_replaced(cache: Path, kept: slice) -> None:
    whole = (cache / "grammar").read_bytes()
    (cache / "grammar").write_bytes(whole[kept])
    assert _reads()
    assert (cache / "grammar").stat().st_size > len(whole) / 2


def test_tables_of_another_lark_are_replaced(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = (cache / "grammar").read_bytes()
    monkeypatch.setattr(lark, "__version__", "1.0")
    assert _reads()
    assert (cache / "grammar").read_bytes() != first


def test_tables_of_another_colony_are_replaced(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = (cache / "grammar").read_bytes()
    (tmp_path / "build.py").write_text("class Builder: ...\n")
    monkeypatch.setattr(parser, "BUILD", tmp_path / "build.py")
    assert _reads()
    assert (cache / "grammar").read_bytes() != first


@pytest.mark.usefixtures("cache")
def test_without_a_place_for_them_the_tables_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    assert _reads()


@pytest.mark.parametrize("mode", [0o777, long(0o702), long(0o770)])
def test_a_folder_that_others_can_write_to_is_not_used(
    cache: Path, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    before = (cache / "grammar").stat().st_ino
    cache.chmod(mode)
    monkeypatch.setattr(lark.Lark, "load", None)
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
