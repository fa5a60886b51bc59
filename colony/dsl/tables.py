"""The parser's tables, built from the grammar once and kept beside it as JSON.

Building them takes a tenth of a second, loading them a few milliseconds. `python -m colony.dsl.tables`
writes the file anew; a test holds file and grammar together.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, BinaryIO, cast

from lark import Lark
from lark import __version__ as lark_version
from lark.grammar import Rule
from lark.lexer import TerminalDef

GRAMMAR = Path(__file__).with_name("grammar.lark")
TABLES = Path(__file__).with_name("grammar_tables.json")


_OPTIONS: dict[str, Any] = {
    "start": "file",
    "parser": "lalr",
    "lexer": "contextual",
    "keep_all_tokens": True,
    "maybe_placeholders": True,
}


def grammar_digest() -> str:
    """What tells one grammar from another; the tables carry that of the grammar they were built from."""
    import hashlib

    return hashlib.sha256(GRAMMAR.read_bytes()).hexdigest()


def build() -> str:
    """The tables of the grammar as JSON text, with the version of lark that wrote them."""
    parser = Lark(GRAMMAR.read_text(encoding="utf-8"), **_OPTIONS)
    data, memo = parser.memo_serialize([TerminalDef, Rule])
    stored = {"lark": lark_version, "grammar": grammar_digest(), "data": _plain(data), "memo": _plain(memo)}
    return json.dumps(stored, separators=(",", ":")).replace('},"', '},\n"') + "\n"


def load(builder: object) -> Lark:
    """A parser that calls `builder` for each rule; from the grammar if another lark wrote the tables."""
    stored = json.loads(TABLES.read_text(encoding="utf-8"))
    if stored["lark"] != lark_version:
        return Lark(GRAMMAR.read_text(encoding="utf-8"), transformer=builder, **_OPTIONS)
    data, memo = stored["data"], {int(k): v for k, v in stored["memo"].items()}
    table = data["parser"]["parser"]
    table["tokens"] = {int(number): name for number, name in table["tokens"].items()}
    table["states"] = {
        int(state): {int(token): tuple(action) for token, action in actions.items()}
        for state, actions in table["states"].items()
    }
    data["options"]["transformer"] = builder
    return Lark.load(cast("BinaryIO", {"data": data, "memo": memo}))


def _plain(value: Any) -> Any:
    """Tuples and sets as lists, sets in order: what JSON can hold."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, set | frozenset):
        return sorted(_plain(v) for v in value)
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value


if __name__ == "__main__":
    TABLES.write_text(build(), encoding="utf-8")
