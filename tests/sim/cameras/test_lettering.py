"""What is written in the simulated building has the sizes of the real one."""

from __future__ import annotations

import numpy as np
import pytest

from colony.nav.maps.signs import (
    CHARACTER_HEIGHT_MM,
    CHARACTERS,
    MARKER_CODES,
    MARKER_WIDTH_MM,
    PLATE_HEIGHT_MM,
    PLATE_WIDTH_MM,
    STRIPE_MM,
)
from colony.sim.cameras.atlas import TEXEL_MM, font_file, marker, plate, posters
from colony.sim.cameras.surfaces import PERSON_STYLES, extinguisher, people


@pytest.mark.parametrize("text", ["376", "A372", "MEN", "LAB", "WWWWW", "I", "1"])
def test_a_plate_is_black_with_white_characters_of_their_height(text: str) -> None:
    picture = plate(text)
    assert (picture.width_mm, picture.height_mm) == (PLATE_WIDTH_MM, PLATE_HEIGHT_MM)
    ink = picture.shades > 0.5
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    assert (rows[-1] - rows[0] + 1) * TEXEL_MM == pytest.approx(CHARACTER_HEIGHT_MM, abs=5.0)
    assert columns[0] * TEXEL_MM >= 10.0
    assert (ink.shape[1] - 1 - columns[-1]) * TEXEL_MM >= 10.0
    assert abs(columns[0] + columns[-1] + 1 - ink.shape[1]) <= 4  # in the middle
    assert picture.shades[0].max() == picture.shades.min() < 0.1


def test_all_characters_differ() -> None:
    drawn = {plate(character).shades.tobytes() for character in CHARACTERS}
    assert len(drawn) == len(CHARACTERS)
    assert plate("").shades.max() < 0.1  # nothing to write


def test_markers_have_their_stripes() -> None:
    for code in MARKER_CODES:
        picture = marker(code)
        assert picture.width_mm == pytest.approx(MARKER_WIDTH_MM)
        assert picture.width_mm / picture.shades.shape[1] == pytest.approx(STRIPE_MM)
        black = (picture.shades[0] < 0.5).tolist()
        assert black[::2] == [True] * 4
        assert black[1::2] == [bool(code >> bit & 1) for bit in (2, 1, 0)]


def test_shades_are_shades() -> None:
    for picture in (*posters(), *people(), extinguisher()):
        assert 0.0 <= picture.shades.min() < picture.shades.max() <= 1.0
    for one in people():
        assert 0.2 < one.opacity.mean() < 0.7
        assert 1600.0 < one.height_mm < 1900.0
    assert len(people()) == 2 * PERSON_STYLES


def test_the_font_is_there() -> None:
    assert font_file().is_file()
