"""The parser of the grammar (`grammar.lark`): lark's LALR(1) with a contextual lexer.

Only this module and `build.py` import lark, and they are imported when a text is parsed. To make the tables
takes more than half a second, so they are kept in the user's cache. What lark saves is a pickle: it is loaded
only from a folder that no other user can write to.
"""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from functools import cache
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import lark
from lark import Lark, TextSlice, Token, Tree
from lark.exceptions import UnexpectedInput

from colony.dsl import ast
from colony.dsl.build import TreeBuilder
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.record import Record, record
from colony.text.units import BASE_UNITS

GRAMMAR = Path(__file__).with_name("grammar.lark")

BUILD = GRAMMAR.with_name("build.py")
"""The file of `TreeBuilder`, which the kept tables name with its methods."""
_MAX_BYTES = 4 * 1024 * 1024
_SEAL_BYTES = sha256().digest_size


@record
class Unexpected(Record):
    """The first unexpected input in a text.

    Attributes:
        offset: the start of the input; at the end of the text, the end of the last token.
        at_end: True if the text ends too early.
        accepted: the terminals that are allowed there.
        values: the values that were read and belong to no larger one yet, in their order.
    """

    offset: int
    at_end: bool
    accepted: frozenset[str]
    values: tuple[Any, ...]


def parse_from(text: str, start: int) -> ast.File | Unexpected:
    """Parse a text from `start` to its end."""
    try:
        return cast("ast.File", _parser().parse(TextSlice(text, start, len(text))))
    except UnexpectedInput as problem:
        return _unexpected(text, start, problem)


def read_tokens(text: str) -> tuple[ast.File, list[Token]] | None:
    """Parse a text, and return the tokens of the lexer, too; None for one with syntax errors.

    Between the tokens are blanks and comments.
    """
    reading = _parser().parse_interactive(text)
    try:
        tokens = reading.exhaust_lexer()
        return cast("ast.File", reading.feed_eof()), tokens  # type: ignore[no-untyped-call]
    except UnexpectedInput:
        return None


def _unexpected(text: str, start: int, problem: UnexpectedInput) -> Unexpected:
    """Read the valid part again: the refused token may have caused reductions that hide what was allowed."""
    token = getattr(problem, "token", None)
    at_end = token is not None and token.type == "$END"
    offset = len(text) if at_end or problem.pos_in_stream is None else problem.pos_in_stream
    valid = _parser().parse_interactive(TextSlice(text, start, offset))
    tokens = valid.exhaust_lexer()
    if at_end:
        offset = cast("int", tokens[-1].end_pos) if tokens else start
    accepted: set[str] = valid.accepts()  # type: ignore[no-untyped-call]
    values = (v.children if isinstance(v, Tree) else v for v in valid.parser_state.value_stack)
    return Unexpected(offset=offset, at_end=at_end, accepted=frozenset(accepted), values=tuple(values))


@cache
def _parser() -> Lark:
    names = sorted(BASE_UNITS, key=lambda name: (-len(name), name))
    grammar = GRAMMAR.read_text(encoding="utf-8").replace("<unit>", "|".join(names))
    made_by = f"{sys.version} {lark.__version__} {grammar}".encode() + BUILD.read_bytes()
    file = user_cache(os.environ, "grammar")
    with suppress(OSError):
        kept = read_from_cache(file, _MAX_BYTES) if file else b""
        seal, tables = kept[:_SEAL_BYTES], kept[_SEAL_BYTES:]
        if sha256(made_by + tables).digest() == seal:
            return Lark.load(BytesIO(tables))
    parser = Lark(
        grammar,
        start="file",
        parser="lalr",
        lexer="contextual",
        keep_all_tokens=True,
        maybe_placeholders=True,
        transformer=TreeBuilder(),
    )
    with suppress(OSError):
        if file:
            parser.save(saved := BytesIO())
            keep_in_cache(file, sha256(made_by + saved.getvalue()).digest() + saved.getvalue())
    return parser


# --- recovery -----------------------------------------------------------------------------------------
#
# Recovery from a syntax error: the declarations before it, the names lost in it, and where to resume.
#
# Imported only after an error, since compiling its patterns would add to the start-up time of every command.

_DECLARATION = re.compile(
    r"^([ \t]*)(?:(?:robot|enum|import|input|(?:tunable[ \t]+)?param|let|state|next|machine"
    r"|(?:failsafe[ \t]+)?module|network|limit|contract|reach|assume|test)"
    r"(?:[ \t]+[A-Za-z_\"{]|[ \t]*[{\"]))",
    re.MULTILINE,
)
_DECLARED = re.compile(
    r"\b(?:robot|enum|param|input|let|state|machine|sequence|module|sensor|actuator|as)[ \t]+([A-Za-z_]\w*)"
    r"|^[ \t]*([A-Za-z_]\w*)[ \t]*=(?!=)",
    re.MULTILINE,
)


CONTEXTUAL_KEYWORDS = frozenset(
    "ROBOT FRAME JITTER SENSOR ACTUATOR RANGE DEFAULT WITHIN FROM TO IDLE ON_LOSS STOP DEGRADE ENUM "
    "IMPORT AS PARAM LET STATE NEXT MACHINE START WHEN MODULE DO PYTHON READS COMMANDS RATE "
    "NETWORK LIMIT CONTRACT TEST AT EVERY GIVEN EXPECT FOR ACTIVE COMMANDED LANGUAGE FAILSAFE TAKEN "
    "AGO INPUT BEARING STEP TIME REACH TUNABLE SEQUENCE UNTIL KEEP RESTART REQUIREMENT ASSUME".split()
)
"""Contextual keywords (except `any`, which is used where phase names are)."""


def lost_names(text: str) -> set[str]:
    """Return the names that a piece of text seems to declare."""
    return {a or b for a, b in _DECLARED.findall(text)}


def expected_terminals(problem: Unexpected) -> frozenset[str]:
    """Return the terminals allowed at the error, without contextual keywords where any name is allowed."""
    accepted = problem.accepted
    return accepted - CONTEXTUAL_KEYWORDS if {"NAME", *CONTEXTUAL_KEYWORDS} <= accepted else accepted


def complete_declarations(problem: Unexpected) -> list[ast.Declaration]:
    """Return the declarations that were read before the error, from the parser's stack."""
    for value in problem.values[:2]:
        if isinstance(value, list):
            return value
        if isinstance(value, DECLARATIONS):
            return [cast("ast.Declaration", value)]
    return []


def language_line(problem: Unexpected) -> ast.LanguageDecl | None:
    """Return the line with the version of the language, if it was read before the error."""
    match problem.values:
        case (ast.LanguageDecl() as line, *_):
            return line
        case (word, version) if getattr(word, "type", "") == "LANGUAGE":  # the error is right after it
            return ast.LanguageDecl(version=version.value, start=word.start_pos, end=version.end_pos)
    return None


DECLARATIONS: tuple[type, ...] = ast.Declaration.__args__


def next_declaration(text: str, declaration_start: int, error_offset: int) -> int:
    """Return the offset at which to resume: a declaration that begins a line at or after the error."""
    begin, indent = _begin_and_indent(text, declaration_start)
    line = text.rfind("\n", 0, error_offset) + 1
    search_from = line if line > begin else text.find("\n", max(error_offset, begin))
    while search_from >= 0:
        match = _DECLARATION.search(text, search_from)
        if match is None:
            break
        if len(match[1]) <= indent:
            return match.start()
        search_from = match.end()
    return len(text)


def new_declaration(text: str, declaration_start: int, error_offset: int) -> int | None:
    """Return the offset, in the line of the error, at which a new declaration seems to begin, if any."""
    begin, indent = _begin_and_indent(text, declaration_start)
    line = text.rfind("\n", 0, error_offset) + 1
    match = _DECLARATION.match(text, line)
    if match is None or line <= begin or len(match[1]) > indent or match.end(1) > error_offset:
        return None
    return match.end(1)


def _begin_and_indent(text: str, declaration_start: int) -> tuple[int, int]:
    """Return the offset of the word that begins the declaration, and the declaration's indentation."""
    blanks = re.compile(r"(?:[ \t\r\n\f]|#[^\r\n]*)*").match(text, declaration_start)
    begin = blanks.end() if blanks else declaration_start
    return begin, begin - (text.rfind("\n", 0, begin) + 1)


# --- completion ---------------------------------------------------------------------------------------


def accepted_at(text: str, start: int, offset: int) -> frozenset[str] | None:
    """Return the terminals that may follow a text from `start` up to `offset`; None if it has an error."""
    valid = _parser().parse_interactive(TextSlice(text, start, offset))
    try:
        valid.exhaust_lexer()
    except UnexpectedInput:
        return None
    accepted: set[str] = valid.accepts()  # type: ignore[no-untyped-call]
    is_word = {"NAME", *CONTEXTUAL_KEYWORDS} <= accepted
    return frozenset(accepted - CONTEXTUAL_KEYWORDS if is_word else accepted)
