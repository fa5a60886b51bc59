"""The stored tables are those of the grammar, and a parser made of either reads the same."""

from __future__ import annotations

import json

import pytest
from lark import Lark

from colony.dsl import tables
from colony.dsl.build import Builder
from tests.dsl.texts import MODULES, ROBOT


def test_the_stored_tables_are_those_of_the_grammar() -> None:
    stored = json.loads(tables.TABLES.read_text(encoding="utf-8"))
    assert stored["grammar"] == tables.grammar_digest(), "run `make tables`"


def test_another_lark_reads_the_grammar_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    text = ROBOT + MODULES
    stored = tables.load(Builder()).parse(text)
    monkeypatch.setattr(tables, "lark_version", "0.0")
    fresh = tables.load(Builder())
    assert isinstance(fresh, Lark)
    assert fresh.parse(text) == stored
