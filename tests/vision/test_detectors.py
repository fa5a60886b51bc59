"""All detectors on images of any size; and whatever array they are given, a result or a `ValueError`."""

from __future__ import annotations

import io
import json
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image

from colony.vision.detections import PlateBox
from colony.vision.detectors import Detection, Detector, detect
from colony.vision.image_files import annotate, decode_image, encode_png
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.scan_lines import ceiling_lights
from colony.vision.markers.rows import find_markers
from colony.vision.plates.detector import find_plates
from colony.vision.plates.reader import read_plate
from tools.second_renderer.measure import CORPUS, overlap

BOX = PlateBox(((2.0, 2.0), (40.0, 3.0), (40.0, 17.0), (2.0, 16.0)), 1.0)


def _entry(name: str) -> dict[str, Any]:
    images = json.loads((CORPUS / "truth.json").read_text(encoding="utf-8"))["images"]
    entry: dict[str, Any] = next(image for image in images if image["file"] == name)
    return entry


def _gray(name: str) -> np.ndarray[Any, np.dtype[np.uint8]]:
    return decode_image((CORPUS / name).read_bytes())[:, :, 0].copy()


@pytest.mark.parametrize("factor", [2, 5])
def test_places_are_told_in_the_pixels_of_a_large_image(factor: int) -> None:
    small = _gray("plates_01.png")
    large = np.asarray(Image.fromarray(small).resize((240 * factor, 120 * factor), Image.Resampling.BICUBIC))
    (target,) = (t for t in _entry("plates_01.png")["targets"] if t["whole"])
    (plate,) = detect(Detector.PLATES, large)
    assert plate.label == target["text"]
    assert overlap((np.array(target["corners"]) + 0.5) * factor - 0.5, np.array(plate.corners)) > 0.8


def test_a_light_of_the_ceiling_in_a_large_image() -> None:
    small = _gray("ceiling_01.png")
    large = np.asarray(Image.fromarray(small).resize((960, 480), Image.Resampling.BICUBIC))
    (here,), (there,) = detect(Detector.LIGHTS, small), detect(Detector.LIGHTS, large)
    for (column, row), (large_column, large_row) in zip(here.corners, there.corners, strict=True):
        assert (large_column + 0.5) / 4.0 - 0.5 == pytest.approx(column, abs=1.5)
        assert (large_row + 0.5) / 4.0 - 0.5 == pytest.approx(row)


@pytest.mark.parametrize("detector", list(Detector))
@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("shape", [(120, 240), (4, 4), (4, 3000), (3000, 4), (500, 300)])
def test_even_images_show_nothing(detector: Detector, level: int, shape: tuple[int, int]) -> None:
    assert detect(detector, np.full(shape, level, dtype=np.uint8)) == ()


@pytest.mark.parametrize("detector", list(Detector))
def test_bad_arrays(detector: Detector) -> None:
    for bad in (np.zeros((0, 0), np.uint8), np.zeros((120, 240)), np.zeros((3, 9), np.uint8)):
        with pytest.raises(ValueError, match="expected"):
            detect(detector, bad)  # type: ignore[arg-type]


ARRAYS = st.one_of(
    arrays.arrays(np.uint8, arrays.array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=64)),
    arrays.arrays(
        st.sampled_from([np.uint8, np.int16, np.uint16, np.float32, np.float64, np.bool_]),
        arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=12),
    ),
)


@given(image=ARRAYS)
@settings(max_examples=120, deadline=None)
def test_any_array_gives_a_result_or_a_value_error(image: np.ndarray[Any, Any]) -> None:
    for work in (
        find_plates,
        find_markers,
        lambda i: read_plate(i, BOX),
        lambda i: ceiling_lights(i, UPWARD),
    ):
        with suppress(ValueError):
            assert isinstance(work(image), tuple)


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(4, 64), columns=st.integers(4, 64))
@settings(max_examples=60, deadline=None)
def test_noise_of_any_size_is_looked_at(seed: int, rows: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    blocks = rng.integers(0, 256, (rows, columns), dtype=np.uint8)
    for detector in Detector:
        for detection in detect(detector, blocks):
            assert np.isfinite(detection.corners).all()


def test_a_picture_that_is_high_and_narrow_is_not_drawn_larger_than_images_may_be() -> None:
    drawn = annotate(np.zeros((20_000, 4, 3), np.uint8), [])
    assert drawn.shape == (20_000, 4, 3)
    assert decode_image(encode_png(drawn)).shape == drawn.shape
    assert annotate(np.zeros((3_000, 100, 3), np.uint8), []).shape == (15_000, 500, 3)


def test_spots_are_drawn_into_an_enlarged_copy() -> None:
    image = np.full((20, 100, 3), 90, dtype=np.uint8)
    before = image.copy()
    corners = ((30.0, 8.0), (60.0, 8.0), (60.0, 16.0), (30.0, 16.0))
    drawn = annotate(image, [(Detector.PLATES, Detection(corners, "364", 1.0, 1.0))])
    assert drawn.shape == (100, 500, 3)
    assert (image == before).all()
    changed = np.argwhere((drawn != 90).any(axis=2))
    assert changed[:, 1].min() == pytest.approx(150, abs=6)
    assert changed[:, 1].max() == pytest.approx(304, abs=6)
    with Image.open(io.BytesIO(encode_png(drawn))) as read:
        assert (np.asarray(read) == drawn).all()


def test_spots_beyond_the_image_are_drawn_as_far_as_they_are_in_it() -> None:
    image = np.zeros((120, 240, 3), dtype=np.uint8)
    corners = ((-1e9, -50.0), (1e9, -50.0), (1e9, 1e9), (-1e9, 60.0))
    drawn = annotate(image, [(d, Detection(corners, "WOMEN", 0.5, 0.5)) for d in Detector])
    assert drawn.shape == (240, 480, 3)
    assert drawn.any()
