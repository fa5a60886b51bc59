"""docs/language.md: the tables leave nothing out."""

from __future__ import annotations

import re

from colony.dsl.check.calls import FUNCTION_NAMES
from colony.dsl.syntax_errors import RESERVED
from colony.text.units import BASE_UNITS
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "language.md").read_text(encoding="utf-8")


def test_the_tables_name_every_function() -> None:
    rows = "\n".join(line.split("|")[1] for line in PAGE.splitlines() if line.startswith("| `"))
    for name in FUNCTION_NAMES:
        assert re.search(rf"`{name}\b", rows), name


def test_every_unit_and_reserved_word_is_named() -> None:
    for name in BASE_UNITS:
        assert f"`{name}`" in PAGE, name
    [listed] = re.findall(r"operator words are reserved: `([^`]*)`", PAGE)
    assert set(listed.split()) == RESERVED
