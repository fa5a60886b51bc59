"""The stored tables are those of the grammar, and what they drive reads as lark does."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest
from lark import Lark
from lark import Token as LarkToken
from lark.exceptions import UnexpectedCharacters, UnexpectedToken

from colony.dsl import tables
from colony.dsl.build import Builder
from colony.dsl.lalr import Parser, Token, UnexpectedInputError
from tests.dsl.texts import MODULES, ROBOT
from tests.paths import BEHAVIORS

TEXTS = [ROBOT + MODULES, "", "import robot", *(p.read_text() for p in BEHAVIORS)]
SLIPS = [
    "",
    " ",
    "=",
    "==",
    "(",
    "}",
    "when",
    "any",
    "robot",
    "mm/s",
    "..",
    "x",
    "ä",
    '"',
    "3 mm",
    "# no\n",
    ".",
]


class _LarksBuilder:
    """The builder for lark, whose tokens are strings."""

    def __getattr__(self, method: str) -> Callable[[list[Any]], Any]:
        build = getattr(Builder(), method)
        return lambda children: build([_token(c) if isinstance(c, LarkToken) else c for c in children])


def _token(token: LarkToken) -> Token:
    assert token.start_pos is not None
    assert token.end_pos is not None
    return Token(token.type, str(token), token.start_pos, token.end_pos)


@pytest.fixture(scope="module")
def lark() -> Lark:
    return tables.lark_parser(transformer=_LarksBuilder())


@pytest.fixture(scope="module")
def parser() -> Parser:
    return Parser(tables.load(), Builder())


def test_the_stored_tables_are_those_of_the_grammar() -> None:
    assert tables.load()["grammar"] == tables.grammar_digest(), "run `make tables`"


@pytest.mark.parametrize("text", TEXTS)
def test_a_text_reads_as_with_lark(lark: Lark, parser: Parser, text: str) -> None:
    assert parser.parse(text) == lark.parse(text)


@pytest.mark.parametrize("seed", range(60))
def test_a_text_with_a_slip_reads_as_with_lark(lark: Lark, parser: Parser, seed: int) -> None:
    random_ = random.Random(seed)
    text = random_.choice(TEXTS)
    begin = random_.randrange(len(text) + 1)
    text = text[:begin] + random_.choice(SLIPS) + text[begin + random_.randrange(8) :]
    assert _read_by(parser, text) == _read_by_lark(lark, text)


def _read_by(parser: Parser, text: str) -> object:
    """The tree, or where reading ends and whether that is the end of the text."""
    try:
        return parser.parse(text)
    except UnexpectedInputError as problem:
        return problem.offset, problem.at_end


def _read_by_lark(lark: Lark, text: str) -> object:
    try:
        return lark.parse(text)
    except UnexpectedToken as problem:
        at_end = problem.token.type == "$END"
        return (problem.token.end_pos if at_end else problem.token.start_pos), at_end
    except UnexpectedCharacters as problem:
        return problem.pos_in_stream, False


BEGINNINGS = ["module a { when", "let a = (1 +", "network { x = a", "limit a.", "robot r { frame 3 s", ""]


@pytest.mark.parametrize("text", BEGINNINGS)
def test_what_could_have_stood_there_is_what_lark_takes(lark: Lark, parser: Parser, text: str) -> None:
    interactive = lark.parse_interactive(text)
    interactive.exhaust_lexer()
    with pytest.raises(UnexpectedInputError) as caught:
        parser.parse(text + " ?")
    assert caught.value.offset == len(text) + 1
    assert caught.value.accepted == interactive.accepts()
