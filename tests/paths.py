"""Folders of the repository that tests read."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MAPS = ROOT / "maps"
BEHAVIORS = sorted((ROOT / "behaviors").glob("*.colony"))
"""The behaviors that come with the project."""
