"""The maps and behaviors that come along, as tests use them."""

from __future__ import annotations

from pathlib import Path

from colony.nav.maps.stickrep.reader import load_map

ROOT = Path(__file__).resolve().parents[1]
MAPS = ROOT / "maps"
BEHAVIORS = ROOT / "behaviors"
LOOP = load_map(MAPS / "loop.stickrep")
HALLWAY = load_map(MAPS / "hallway.stickrep")
MSU = load_map(MAPS / "msu_engineering_3.stickrep")
