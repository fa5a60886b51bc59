"""Reading of door plates: fonts that were never learned, several looks, and what is no plate."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from colony.vision.detections import Corner, PlateBox, PlateReading
from colony.vision.letters.decoding import LetterNet, network, packed, unpacked
from colony.vision.plates.reader import combine_readings, read_plate
from tests.sampling import sampled
from tools.training.fonts import learned_fonts, unseen_fonts
from tools.training.samples import Sample, junk_sample, plate_sample
from tools.training.texts import door_text

UNSEEN = unseen_fonts()


def _box(look: Sample) -> PlateBox:
    return PlateBox(look.corners, 1.0)


def _read(look: Sample) -> PlateReading:
    return read_plate(look.image, _box(look))


def _square(*corners: Corner) -> PlateBox:
    a, b, c, d = corners
    return PlateBox((a, b, c, d), 1.0)


@pytest.mark.parametrize("font", sampled(UNSEEN, every=9, thorough=True), ids=lambda font: font.stem)
@pytest.mark.parametrize(("height_px", "least"), [(10.0, 27), (14.0, 35), (20.0, 36), (40.0, 36)])
def test_single_looks_at_fonts_that_were_never_learned(font: Path, height_px: float, least: int) -> None:
    random = np.random.default_rng(5)
    looks = [plate_sample(door_text(random), font, height_px, random) for _ in range(40)]
    assert sum(_read(look).text == look.text for look in looks) >= least


@pytest.mark.parametrize("font", sampled(UNSEEN, every=9, thorough=True), ids=lambda font: font.stem)
def test_looks_of_a_pass_together_are_better_than_one(font: Path) -> None:
    random = np.random.default_rng(6)
    right, single = 0, 0
    for _ in range(25):
        text = door_text(random)
        readings = [_read(plate_sample(text, font, 10.0, random)) for _ in range(6)]
        right += combine_readings(readings).text == text
        single += readings[0].text == text
    assert right >= max(24, single)


def test_what_is_no_plate_is_not_read() -> None:
    random = np.random.default_rng(7)
    fonts = learned_fonts()
    looks = [junk_sample(fonts[i % len(fonts)], random) for i in range(200)]
    readings = [_read(look) for look in looks]
    assert sum(bool(reading.text) for reading in readings) <= 10
    assert sum(bool(reading.text) and reading.confidence >= 0.9 for reading in readings) <= 5


def test_confidence_says_how_often_a_reading_is_right() -> None:
    random = np.random.default_rng(8)
    looks = [plate_sample(door_text(random), UNSEEN[i % len(UNSEEN)], 9.0, random) for i in range(300)]
    readings = [_read(look) for look in looks]
    right = [reading.text == look.text for reading, look in zip(readings, looks, strict=True)]
    said = [reading.confidence for reading in readings]
    assert abs(np.mean(said) - np.mean(right)) < 0.08
    sure = [ok for ok, share in zip(right, said, strict=True) if share > 0.9]
    unsure = [ok for ok, share in zip(right, said, strict=True) if share < 0.6]
    assert len(sure) > 50
    assert np.mean(sure) > 0.93
    assert not unsure or np.mean(unsure) < 0.75


def test_a_lexicon_helps_where_characters_are_small() -> None:
    random = np.random.default_rng(9)
    lexicon = [f"{number}" for number in range(301, 385, 2)] + ["A342", "MEN", "STAIR"]
    free, helped = 0, 0
    for i in range(60):
        text = lexicon[i % len(lexicon)]
        look = plate_sample(text, UNSEEN[i % len(UNSEEN)], 6.0, random)
        free += _read(look).text == text
        helped += read_plate(look.image, _box(look), lexicon=lexicon).text == text
    assert helped >= 42
    assert helped > free


def test_a_text_that_is_plain_to_see_is_read_though_the_lexicon_lacks_it() -> None:
    look = plate_sample("582", UNSEEN[0], 30.0, np.random.default_rng(10), 0.0)
    assert read_plate(look.image, _box(look), lexicon=["340", "342"]).text == "582"


@pytest.mark.parametrize("text", ["", "A 1", "a1", "123456"])
def test_a_lexicon_of_what_is_on_no_plate_is_refused(text: str) -> None:
    image = np.zeros((20, 40), np.uint8)
    box = _square((2, 2), (37, 2), (37, 17), (2, 17))
    with pytest.raises(ValueError, match="the lexicon has the text"):
        read_plate(image, box, lexicon=["340", text])


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    "box",
    [
        _square((NAN, 2), (37, 2), (37, 17), (2, 17)),
        _square((2, 2), (INF, 2), (37, 17), (2, 17)),
        _square((5, 5), (5, 5), (5, 5), (5, 5)),
        _square((37, 2), (2, 2), (2, 17), (37, 17)),
        _square((2, 17), (37, 17), (37, 2), (2, 2)),
        _square((2, 2), (37, 17), (37, 2), (2, 17)),
        _square((0, 0), (1e9, 0), (1e9, 1e9), (0, 1e9)),
        _square((3, 3), (6, 3), (6, 5), (3, 5)),
    ],
    ids=["nan", "infinite", "point", "mirrored", "upside down", "crossed", "huge", "tiny"],
)
def test_corners_of_no_plate_read_as_nothing(box: PlateBox) -> None:
    image = np.random.default_rng(0).integers(0, 256, (120, 240), dtype=np.uint8)
    assert read_plate(image, box).text == ""


@pytest.mark.parametrize("level", [0, 128, 255])
def test_an_even_image_reads_as_nothing(level: int) -> None:
    image = np.full((120, 240), level, np.uint8)
    assert read_plate(image, _square((100, 50), (140, 50), (140, 64), (100, 64))).text == ""


def test_a_box_outside_of_the_image_reads_as_nothing() -> None:
    image = np.random.default_rng(0).integers(0, 256, (120, 240), dtype=np.uint8)
    assert read_plate(image, _square((900, 50), (940, 50), (940, 64), (900, 64))).text == ""


@pytest.mark.parametrize(
    "image",
    [np.zeros((120, 240), np.float32), np.zeros((0, 240), np.uint8), np.zeros((5, 6, 2), np.uint8)],
    ids=["float", "empty", "two channels"],
)
def test_what_is_no_gray_image_is_refused(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="an image of"):
        read_plate(image, _square((2, 2), (37, 2), (37, 17), (2, 17)))


def test_looks_that_disagree_are_weighed_by_their_confidence() -> None:
    faint = PlateReading("346", 0.5, (("348", 0.45),))
    clear = PlateReading("348", 0.9, (("346", 0.08),))
    assert combine_readings([faint, faint, clear]).text == "348"
    assert combine_readings([faint, faint]).text == "346"
    assert combine_readings([faint, faint, faint]).confidence > faint.confidence


def test_one_look_at_something_else_does_not_spoil_the_rest() -> None:
    good, other = PlateReading("346", 0.99), PlateReading("", 1.0)
    assert combine_readings([good, other, good]).text == "346"
    assert combine_readings([other, good, other]).text == ""


def test_no_looks_tell_nothing() -> None:
    assert combine_readings([]) == PlateReading("", 0.0)


def test_one_look_is_itself() -> None:
    look = PlateReading("346", 0.8, (("348", 0.15),))
    once = combine_readings([look])
    assert once.text == "346"
    assert once.confidence == pytest.approx(0.8, abs=0.06)


def test_weights_are_read_once() -> None:
    assert network() is network()


def test_weights_tell_how_they_were_trained() -> None:
    facts = network().facts
    assert facts.startswith("seed ")
    for font in (*learned_fonts(), *UNSEEN):
        assert font.stem in facts


def test_weights_survive_being_stored() -> None:
    once = unpacked(packed(network()))
    assert isinstance(once, LetterNet)
    for before, after in zip(network().layers, once.layers, strict=True):
        np.testing.assert_allclose(after.kernel, before.kernel, rtol=0.0, atol=1e-6)


def test_a_file_that_lacks_weights_is_refused() -> None:
    arrays = packed(network())
    del arrays["bias3"]
    with pytest.raises(ValueError, match=r"lack bias3; train them again"):
        unpacked(arrays)


def test_layers_that_do_not_fit_are_refused() -> None:
    arrays = packed(network())
    arrays["kernel2"], arrays["scale2"] = arrays["kernel1"], arrays["scale1"]
    with pytest.raises(ValueError, match="channels; expected"):
        unpacked(arrays)
