"""The grammars of editors scope every token of the shipped files as the lexer of the language reads it."""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from colony.dsl.parse import parse_with_tokens
from colony.dsl.parser import CONTEXTUAL_KEYWORDS
from colony.text.source import Source
from colony.text.units import BASE_UNITS
from tests.paths import BEHAVIORS, ROOT, THESIS_NAVIGATOR
from tools import editor_grammar

FILES = [*BEHAVIORS, THESIS_NAVIGATOR, *sorted((ROOT / "examples").rglob("*.colony"))]
_WORD = re.compile(r"[A-Za-z_]\w*")


def expected(text: str) -> Iterator[tuple[int, str, str]]:
    """Yield offset, text and class of each token and comment."""
    _, tokens = parse_with_tokens(Source("<text>", text))
    end = 0
    for token in tokens:
        start = token.start_pos or 0
        yield from ((end + m.start(), m[0], "comment") for m in re.finditer(r"#[^\n]*", text[end:start]))
        value = str(token)
        if token.type == "NUMBER":
            kind = "number"
        elif token.type == "STRING":
            kind = "string"
        elif token.type in ("TRUE", "FALSE", "MISSING"):
            kind = "constant"
        elif _WORD.fullmatch(value) and token.type not in ("NAME", "FIELD", "UNIT"):
            kind = "keyword"
        else:
            kind = "other"
        yield start, value, kind
        end = token.end_pos or 0


def scoped(line: str, patterns: list[tuple[re.Pattern[str], dict[str, str]]]) -> dict[int, str]:
    """Return the scope of each character, by the pattern that matches first, as TextMate engines go by."""
    scopes: dict[int, str] = {}
    at = 0
    while at < len(line):
        found = [(m.start(), i, m) for i, (p, _) in enumerate(patterns) if (m := p.search(line, at))]
        if not found:
            break
        _, i, match = min(found, key=lambda one: one[:2])
        for group, scope in patterns[i][1].items():
            scopes |= dict.fromkeys(range(*match.span(int(group))), scope)
        at = max(match.end(), at + 1)
    return scopes


def class_of(scope: str) -> str:
    heads = {
        "comment": "comment",
        "string": "string",
        "constant.numeric": "number",
        "constant.language": "constant",
        "keyword.control": "keyword",
        "keyword.declaration": "keyword",
        "keyword.operator.word": "keyword",
    }
    return next((name for head, name in heads.items() if scope.startswith(head)), "other")


def textmate() -> list[tuple[re.Pattern[str], dict[str, str]]]:
    grammar = json.loads(editor_grammar.TARGET.read_text(encoding="utf-8"))
    return [
        (
            re.compile(p["match"]),
            {"0": p["name"]} if "name" in p else {g: c["name"] for g, c in p["captures"].items()},
        )
        for p in grammar["patterns"]
    ]


def test_the_grammar_is_that_of_the_language() -> None:
    assert editor_grammar.TARGET.read_text(encoding="utf-8") == editor_grammar.text()
    contextual, reserved = editor_grammar.keywords()
    assert {word.upper() for word in contextual} == CONTEXTUAL_KEYWORDS
    assert {"and", "implies", "suppresses", "by"} <= set(reserved)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_textmate_scopes_each_token_as_the_lexer_reads_it(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    patterns, lines = textmate(), text.split("\n")
    scopes = [scoped(line, patterns) for line in lines]
    source = Source(str(path), text)
    for offset, value, kind in expected(text):
        number, column = source.position(offset)
        scope = scopes[number - 1].get(column - 1, "")
        assert scope, f"{path.name}:{number}:{column}: `{value}` has no scope"
        assert class_of(scope) == kind, f"{path.name}:{number}:{column}: `{value}` is {scope}"
        if kind == "number" and not value[-1].isdigit():
            last = scopes[number - 1][column - 1 + len(value) - 1]
            assert last.startswith("keyword.other.unit"), f"{path.name}:{number}: `{value}` has no unit"


def pygments_lexer() -> Any:
    """Return the module of the lexer, which is a package of its own."""
    pytest.importorskip("pygments")
    path = ROOT / "editors" / "pygments" / "colony_pygments.py"
    spec = importlib.util.spec_from_file_location("colony_pygments", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_words_of_the_lexer_are_those_of_the_language() -> None:
    module = pygments_lexer()
    contextual, reserved = editor_grammar.keywords()
    beside = {
        "contract",
        "reach",
        "assume",
        "active",
        "commanded",
        "time",
        "on_loss",
        "stop",
        "degrade",
        "ago",
    }
    assert {*module.DECLARING, *module.BEFORE_MINUS, *module.CLAUSES, *beside} == set(contextual)
    assert set(module.RESERVED) == set(reserved)
    assert set(module.CONSTANTS) == editor_grammar.CONSTANTS
    assert all(re.fullmatch(module._UNIT, f"{unit}/{unit}^2") for unit in BASE_UNITS)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_pygments_reads_each_token_as_the_lexer_does(path: Path) -> None:
    module = pygments_lexer()
    text = path.read_text(encoding="utf-8")
    classes = {
        "Comment": "comment",
        "Literal.String": "string",
        "Literal.Number": "number",
        "Keyword.Constant": "constant",
        "Keyword.Type": "other",
        "Keyword": "keyword",
        "Operator.Word": "keyword",
    }
    found = {}
    for offset, token, value in module.ColonyLexer().get_tokens_unprocessed(text):
        kind = str(token).removeprefix("Token.")
        assert kind != "Error", f"{path.name}: {value!r} at {offset}"
        name = next((name for head, name in classes.items() if kind.startswith(head)), "other")
        found |= dict.fromkeys(range(offset, offset + len(value)), name)
    for offset, value, kind in expected(text):
        assert found[offset] == kind, f"{path.name}: `{value}` at {offset} is {found[offset]}"
