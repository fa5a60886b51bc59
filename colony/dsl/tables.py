"""The parser's tables, built from the grammar and the table of units by lark, and kept beside them as JSON.

`python -m colony.dsl.tables` regenerates the file; only this needs lark. A test checks that it is up to date.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from colony.text.units import BASE_UNITS

if TYPE_CHECKING:
    from lark import Lark
    from lark.grammar import Rule

GRAMMAR = Path(__file__).with_name("grammar.lark")
TABLES = Path(__file__).with_name("grammar_tables.json")


def load() -> dict[str, Any]:
    """Return the stored tables for `colony.dsl.lalr.Parser`."""
    tables: dict[str, Any] = json.loads(TABLES.read_bytes())
    return tables


def grammar_text() -> str:
    """Return the grammar with the names of the units in its patterns."""
    names = sorted(BASE_UNITS, key=lambda name: (-len(name), name))
    return GRAMMAR.read_text(encoding="utf-8").replace("<unit>", "|".join(names))


def grammar_digest() -> str:
    """Return a digest of the grammar; the tables contain that of the grammar they were built from."""
    import hashlib

    return hashlib.sha256(grammar_text().encode()).hexdigest()


def build() -> str:
    """Return the tables of the grammar as JSON text."""
    from lark.lexer import BasicLexer
    from lark.parsers.lalr_analysis import Shift

    grammar = lark_parser()
    conf, table = grammar.parser.lexer_conf, grammar.parser.parser._parse_table
    terminals = [t for t in BasicLexer(conf).terminals if t.name not in conf.ignore]
    punctuation = {t.pattern.value: t.name for t in terminals if t.pattern.type == "str"}
    words = {t.pattern.value[:-2]: t.name for t in terminals if t.pattern.value.endswith(r"\b")}
    fixed_names = {*punctuation.values(), *words.values()}
    rules = grammar.rules
    reduce_actions = {rule: ~i for i, rule in enumerate(rules)}
    stored = {
        "grammar": grammar_digest(),
        "words": words,
        "signs": punctuation,
        "patterns": [[t.name, t.pattern.to_regexp()] for t in terminals if t.name not in fixed_names],
        "start": table.start_states["file"],
        "final": table.end_states["file"],
        "rules": [_encode_rule(rule) for rule in rules],
        "rows": [
            {symbol: arg if action is Shift else reduce_actions[arg] for symbol, (action, arg) in row.items()}
            for _, row in sorted(table.states.items())
        ],
    }
    return json.dumps(stored, separators=(",", ":")).replace("},{", "},\n{").replace("],[", "],\n[") + "\n"


def lark_parser(**options: Any) -> Lark:
    """Return lark's own parser of the grammar, from which the tables are built."""
    from lark import Lark

    return Lark(
        grammar_text(),
        start="file",
        parser="lalr",
        lexer="contextual",
        keep_all_tokens=True,
        maybe_placeholders=True,
        **options,
    )


def _encode_rule(rule: Rule) -> list[Any]:
    """Return [nonterminal, size, method, layout] (see `lalr.Rule`).

    `method` is None if the value is the only child, or the list of children of a helper rule.
    """
    size, name = len(rule.expansion), rule.origin.name
    is_helper = name.startswith("_")
    is_child = rule.options.expand1 and not rule.alias and size == 1
    absent = [len(gap) for gap in "".join(str(int(e)) for e in rule.options.empty_indices).split("0")]
    absent += [0] * (size + 1 - len(absent))
    lists = [int(not s.is_term and s.name.startswith("_")) for s in rule.expansion]
    layout = [[a, b] for a, b in zip(absent, [*lists, 0], strict=True)]
    method = None if is_helper or is_child else rule.alias or name
    return [name, size, method, layout if any(map(any, layout)) else None]


if __name__ == "__main__":
    TABLES.write_text(build(), encoding="utf-8")
