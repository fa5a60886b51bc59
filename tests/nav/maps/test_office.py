"""The office that comes with the project."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from colony.nav.maps.world_map import load_world
from tests.nav.maps.grid.office import write_office
from tests.paths import MAPS


def test_it_is_what_its_script_draws(tmp_path: Path) -> None:
    write_office(tmp_path)
    assert (tmp_path / "office.yaml").read_text() == (MAPS / "office.yaml").read_text()
    drawn, kept = (np.asarray(Image.open(folder / "office.png")) for folder in (tmp_path, MAPS))
    assert np.array_equal(drawn, kept)


def test_an_amr_starts_where_the_map_begins() -> None:
    assert load_world(MAPS / "office.yaml").start(400.0) == (0.0, 0.0, 270.0)
