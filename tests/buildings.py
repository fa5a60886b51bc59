"""The buildings that come with the project, as maps."""

from __future__ import annotations

from colony.nav.maps.stickrep.reader import load_map
from tests.paths import MAPS

LOOP = load_map(MAPS / "loop.stickrep")
HALLWAY = load_map(MAPS / "hallway.stickrep")
MSU = load_map(MAPS / "msu_engineering_3.stickrep")
