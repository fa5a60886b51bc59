"""docs/plates.md: it has every column, every finder, and the published totals."""

from __future__ import annotations

import re

from colony.experiment.plates.record import FINDER_NAMES, PLATE_TABLE
from colony.nav.confidence.published_plates import PUBLISHED_WALKS
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "plates.md").read_text(encoding="utf-8")


def test_every_column_is_explained() -> None:
    assert not set(PLATE_TABLE.columns) - set(re.findall(r"`([^`]+)`", PAGE))


def test_every_finder_is_explained() -> None:
    for name in FINDER_NAMES.values():
        assert f"\n| {name} | " in PAGE


def test_the_published_totals_are_those_of_the_table() -> None:
    found, missed, false = (
        sum(len(part) for part in parts)
        for parts in zip(*((w.found, w.missed, w.false) for w in PUBLISHED_WALKS), strict=True)
    )
    assert f"{found} detected plates, {missed} missed and {false} false ones" in PAGE
