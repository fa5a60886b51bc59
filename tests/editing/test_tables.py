"""What editors know of the language is all of it."""

from __future__ import annotations

import re

from colony.dsl.check.calls import FUNCTION_NAMES
from colony.dsl.parser import GRAMMAR
from colony.editing.features.symbols import KINDS
from colony.editing.features.tokens import TOKEN_TYPES
from colony.editing.functions import FUNCTIONS
from colony.editing.index import KINDS as DECLARED
from colony.editing.text import KEYWORDS
from tests.paths import ROOT


def test_every_function_is_explained() -> None:
    assert set(FUNCTIONS) == set(FUNCTION_NAMES)
    assert all(usage.startswith(f"{name}(") for name, (usage, _) in FUNCTIONS.items())


def test_every_word_of_the_grammar_is_a_keyword() -> None:
    words = re.findall(
        r"^[A-Z_]+(?:\.2)?: /([a-z_]+)\\b/$", GRAMMAR.read_text(encoding="utf-8"), re.MULTILINE
    )
    assert len(words) > 60
    assert set(words) == KEYWORDS


def test_every_kind_of_declaration_has_a_symbol() -> None:
    assert set(KINDS) == set(DECLARED)
    assert TOKEN_TYPES[:4] == ("comment", "string", "number", "keyword")  # as the groups of the pattern


def test_the_page_has_every_setting_and_command() -> None:
    from colony.editing.server.methods import COMMANDS
    from colony.editing.server.protocol import Settings

    page = (ROOT / "docs" / "lsp.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| `(.*?)` \|", page, re.MULTILINE))
    settings = Settings()
    shown = {name: str(getattr(settings, name)).lower() for name in settings.__struct_fields__}
    assert rows == {name: value.removesuffix(".0") or '""' for name, value in shown.items()}
    assert all(f"`{command}`" in page for command in COMMANDS)
