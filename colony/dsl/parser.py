"""The parser of the grammar (`grammar.lark`): lark's LALR(1) with a contextual lexer.

Only this module and `build.py` import lark, and they are imported when a text is parsed. To make the tables
takes more than half a second, so they are kept in the user's cache. What lark saves is a pickle: it is loaded
only from a folder that no other user can write to.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from functools import cache
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import lark
from lark import Lark, TextSlice, Tree
from lark.exceptions import UnexpectedInput

from colony.dsl import ast
from colony.dsl.build import Builder
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.record import Record, record
from colony.text.units import BASE_UNITS

GRAMMAR = Path(__file__).with_name("grammar.lark")
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
    made_by = f"{sys.version} {lark.__version__} {grammar}".encode()
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
        transformer=Builder(),
    )
    with suppress(OSError):
        if file:
            parser.save(saved := BytesIO())
            keep_in_cache(file, sha256(made_by + saved.getvalue()).digest() + saved.getvalue())
    return parser
