"""Buildings for the tests of this package."""

from __future__ import annotations

from pathlib import Path

from colony.nav.maps.stickrep.reader import load_map

MAPS = Path(__file__).resolve().parents[2] / "maps"
LOOP = load_map(MAPS / "loop.stickrep")
HALLWAY = load_map(MAPS / "hallway.stickrep")
MSU = load_map(MAPS / "msu_engineering_3.stickrep")
