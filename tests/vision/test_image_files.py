"""Images that people bring: every kind that cameras and programs write, and every way in which one is bad."""

from __future__ import annotations

import io
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from colony.vision.image_files import MAX_BYTES, ImageFormatError, decode_image

RAMP = np.arange(0, 240, 4, dtype=np.uint8).reshape(6, 10)


def encoded(image: Image.Image, kind: str, **options: Any) -> bytes:
    stream = io.BytesIO()
    image.save(stream, kind, **options)
    return stream.getvalue()


@pytest.mark.parametrize("kind", ["PNG", "BMP", "TIFF"])
def test_gray_pictures_stay_as_they_are(kind: str) -> None:
    image = decode_image(encoded(Image.fromarray(RAMP), kind))
    assert image.dtype == np.uint8
    assert image.shape == (6, 10, 3)
    assert (image == RAMP[:, :, None]).all()


@pytest.mark.parametrize(("kind", "options"), [("JPEG", {"quality": 95}), ("WEBP", {"lossless": True})])
def test_pictures_that_are_compressed_with_losses(kind: str, options: dict[str, object]) -> None:
    image = decode_image(encoded(Image.fromarray(RAMP).convert("RGB"), kind, **options))
    assert np.abs(image.astype(int) - RAMP[:, :, None]).max() <= 6


def test_red_green_and_blue_keep_their_order() -> None:
    color = np.zeros((4, 5, 3), dtype=np.uint8)
    color[:] = 200, 100, 50
    assert (decode_image(encoded(Image.fromarray(color), "PNG")) == color).all()


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_16_bits_are_made_8(kind: str) -> None:
    wide = Image.fromarray(RAMP.astype(np.uint16) * 257)
    assert (decode_image(encoded(wide, kind)) == RAMP[:, :, None]).all()


def test_parts_of_one_are_levels() -> None:
    parts = Image.fromarray(RAMP.astype(np.float32) / 255.0)
    assert (decode_image(encoded(parts, "TIFF")) == RAMP[:, :, None]).all()


@pytest.mark.parametrize("mode", ["RGBA", "LA"])
def test_what_is_transparent_is_white(mode: str) -> None:
    clear = Image.new(mode, (6, 5), 0)
    assert (decode_image(encoded(clear, "PNG")) == 255).all()


@pytest.mark.parametrize("mode", ["1", "P", "CMYK"])
def test_other_kinds_of_pixels(mode: str) -> None:
    image = Image.new("RGB", (6, 5), (255, 255, 255)).convert(mode)
    assert (decode_image(encoded(image, "TIFF" if mode == "CMYK" else "PNG")) >= 250).all()


def test_pictures_are_upright_as_the_camera_tells() -> None:
    turned = Image.Exif()
    turned[0x0112] = 6  # to be turned clockwise by a quarter
    data = encoded(Image.fromarray(RAMP), "PNG", exif=turned)
    assert (decode_image(data)[:, :, 0] == np.rot90(RAMP, -1)).all()


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "the file is empty"),
        (b"robot r {\n}\n", "not a readable image; expected PNG"),
        (bytes(1000), "not a readable image"),
        (b"\x89PNG\r\n\x1a\n", "not a readable image"),
        (bytes(MAX_BYTES + 1), "more than 64 MB"),
    ],
)
def test_what_is_no_image(data: bytes, why: str) -> None:
    with pytest.raises(ImageFormatError, match=why):
        decode_image(data)


@pytest.mark.parametrize("size", [(1, 1), (3, 100), (100, 3)])
def test_too_small(size: tuple[int, int]) -> None:
    with pytest.raises(ImageFormatError, match=f"{size[0]} x {size[1]} pixels; expected at least 4 x 4"):
        decode_image(encoded(Image.new("L", size), "PNG"))


@pytest.mark.parametrize(
    ("side", "why"),
    [
        (8_000, "8000 x 8000 pixels; expected at most 50 million"),
        (10_000, "10000 x 10000 pixels; expected at most 50 million"),
        (30_000, "far more pixels than expected: at most 50 million"),
    ],
)
def test_too_large_is_told_before_it_is_read(side: int, why: str) -> None:
    data = bytearray(encoded(Image.new("L", (8, 8)), "PNG"))
    data[16:24] = side.to_bytes(4, "big") * 2
    data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    with pytest.raises(ImageFormatError, match=why):
        decode_image(bytes(data))


@pytest.mark.parametrize("size", [(4, 30_001), (30_001, 4)])
def test_a_side_that_no_picture_of_it_could_have_is_told(size: tuple[int, int]) -> None:
    with pytest.raises(
        ImageFormatError, match=f"{size[0]} x {size[1]} pixels; expected at most 30000 a side"
    ):
        decode_image(encoded(Image.new("L", size), "PNG"))


NOISE = np.random.default_rng(3).integers(0, 256, (20, 30, 3), dtype=np.uint8)
FILES = {
    kind: encoded(Image.fromarray(NOISE), kind) for kind in ("PNG", "JPEG", "BMP", "WEBP", "TIFF")
}  # fmt: skip


@given(kind=st.sampled_from(sorted(FILES)), part=st.floats(0.0, 1.0, exclude_max=True))
@settings(max_examples=150, deadline=None)
def test_files_that_end_too_early_are_bad_or_read(kind: str, part: float) -> None:
    _bad_or_read(FILES[kind][: int(part * len(FILES[kind]))])


@given(
    kind=st.sampled_from(sorted(FILES)),
    changes=st.lists(st.tuples(st.integers(0, 4000), st.integers(0, 255)), min_size=1, max_size=12),
)
@settings(max_examples=150, deadline=None)
def test_files_with_wrong_bytes_are_bad_or_read(kind: str, changes: list[tuple[int, int]]) -> None:
    data = bytearray(FILES[kind])
    for at, byte in changes:
        data[at % len(data)] = byte
    _bad_or_read(bytes(data))


def _bad_or_read(data: bytes) -> None:
    try:
        image = decode_image(data)
    except ImageFormatError:
        return
    assert image.dtype == np.uint8
    assert image.ndim == 3
    assert image.shape[2] == 3
