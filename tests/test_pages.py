"""All pages: their links lead somewhere, also within a page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.paths import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        file, _, anchor = target.partition("#")
        if ":" not in file:
            leads_to = page.parent / file if file else page
            assert leads_to.exists(), target
            assert not anchor or anchor in _anchors(leads_to), target


def _anchors(page: Path) -> set[str]:
    """The names of its headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


FOLDERS = [ROOT, ROOT / "colony", *(path for path in (ROOT / "colony").rglob("*") if path.is_dir())]
"""Folders in which paths in the text of a page begin."""


@pytest.mark.parametrize("page", ["ARCHITECTURE.md", "CONTRIBUTING.md"])
def test_paths_in_the_text_are_there(page: str) -> None:
    paths = re.findall(r"`([a-z_]+/[\w./]*)`", (ROOT / page).read_text(encoding="utf-8"))
    assert len(paths) > 2
    lost = [path for path in paths if not any((folder / path).exists() for folder in FOLDERS)]
    assert not [path for path in lost if "NAME" not in path]
