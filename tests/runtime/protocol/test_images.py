"""Images: bytes that fit their size, bands of rows, arrays."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from colony.runtime.library.camera import array
from colony.runtime.protocol.images import Image


def ramp(height: int = 4, width: int = 3, channels: int = 1) -> Image:
    size = height * width * channels
    return Image(t_ns=5, height=height, width=width, channels=channels, pixels=bytes(range(size)))


def test_a_band_is_an_image_that_knows_its_place() -> None:
    band = ramp().rows(1, 2)
    assert band == Image(t_ns=5, height=2, width=3, channels=1, pixels=bytes(range(3, 9)), first_row=1)
    assert band.rows(1, 1) == ramp().rows(2, 1)
    assert ramp().rows(0, 4) == ramp()


@pytest.mark.parametrize(("first", "count"), [(-1, 1), (0, 0), (0, 5), (4, 1), (3, 2), (0, -1)])
def test_rows_that_are_not_there(first: int, count: int) -> None:
    with pytest.raises(ValueError, match="rows 0 to 3"):
        ramp().rows(first, count)


def test_bytes_must_fit_the_size() -> None:
    with pytest.raises(ValueError, match="an image of 2 x 2 x 1 with 3 bytes"):
        Image(t_ns=0, height=2, width=2, channels=1, pixels=b"abc")
    with pytest.raises(ValueError, match="an image of 0 x"):
        Image(t_ns=0, height=0, width=2, channels=1, pixels=b"")


def test_a_damaged_image_is_not_decoded() -> None:
    odd = msgspec.msgpack.encode([5, 2, 2, 1, b"abc", 0])
    with pytest.raises(msgspec.ValidationError, match="3 bytes"):
        msgspec.msgpack.decode(odd, type=Image)


def test_arrays_have_the_shape_of_the_image() -> None:
    gray = array(ramp())
    assert (gray.shape, gray.dtype) == ((4, 3), np.uint8)
    assert gray[1, 0] == 3
    color = array(ramp(channels=3))
    assert color.shape == (4, 3, 3)
    assert color[0, 1].tolist() == [3, 4, 5]
    assert not color.flags.writeable
