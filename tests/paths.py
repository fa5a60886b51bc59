"""Folders of the repository that tests read."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MAPS = ROOT / "maps"
THESIS_NAVIGATOR = ROOT / "studies" / "thesis" / "thesis_navigator.colony"
ROBOTS = sorted((ROOT / "robots").glob("*/*.colony"))
"""The robots that come with the project."""

BEHAVIORS = sorted([*(ROOT / "behaviors").glob("*.colony"), *ROBOTS], key=lambda path: path.stem)
"""The behaviors that come with the project, with its robots."""
