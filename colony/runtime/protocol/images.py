"""Images as plain bytes, so that servers relay them without numpy."""

from __future__ import annotations

from typing import Protocol

import msgspec


class Image(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """An image, or a band of rows of one, taken at `t_ns`.

    `pixels` has one byte per channel, interleaved, pixels from left to right, rows from top to bottom.
    `first_row` is the row of the whole image at which a band begins; `height` is the height of the band.

    Raises:
        ValueError: a dimension is not above 0, or `pixels` does not have height x width x channels bytes.
    """

    t_ns: int
    height: int
    width: int
    channels: int
    pixels: bytes
    first_row: int = 0

    def __post_init__(self) -> None:
        """Check the size of the image."""
        size = self.height * self.width * self.channels
        if min(self.height, self.width, self.channels) <= 0 or len(self.pixels) != size:
            shape = f"{self.height} x {self.width} x {self.channels}"
            raise ValueError(f"an image of {shape} with {len(self.pixels)} bytes")

    def rows(self, first: int, count: int) -> Image:
        """Return the band of `count` rows that begins with row `first` of this image.

        Raises:
            ValueError: the image does not have these rows.
        """
        if first < 0 or count <= 0 or first + count > self.height:
            raise ValueError(
                f"{count} rows from row {first} on; expected at least 1 of rows 0 to {self.height - 1}"
            )
        line = self.width * self.channels
        return msgspec.structs.replace(
            self,
            height=count,
            pixels=self.pixels[first * line : (first + count) * line],
            first_row=self.first_row + first,
        )


class Shot(Protocol):
    """A captured image, whose pixels already exist (`Image`) or are rendered when they are read."""

    @property
    def height(self) -> int:
        """Height in pixels."""
        ...

    @property
    def width(self) -> int:
        """Width in pixels."""
        ...

    @property
    def channels(self) -> int:
        """Number of channels of a pixel."""
        ...

    def rows(self, first: int, count: int) -> Image:
        """Return the band of `count` rows that begins with row `first`.

        Raises:
            ValueError: the image does not have these rows.
        """
        ...
