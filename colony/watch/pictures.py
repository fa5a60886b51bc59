"""Pictures of a robot's cameras for pages: reduced, with what the detectors find in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from colony.extras import EXTRAS, installed
from colony.runtime.protocol.images import Image

MAX_WIDTH, MAX_HEIGHT = 320, 240
"""Maximum size of a picture in pixels; larger images are reduced by a whole factor."""

RGB = 3
"""Channels of a colored image; with any other number the first channel is shown, in gray."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What a detector found: a plate or a marker.

    Attributes:
        kind: the kind of detector.
        label: text of a plate, "" if it cannot be read; bits of a marker.
        corners: corners clockwise from the upper left, in pixels; pixel i extends from i - 0.5 to i + 0.5.
    """

    kind: str
    label: str
    corners: tuple[tuple[float, float], ...]


Find = Callable[[Image], tuple[Finding, ...]]
"""Function that returns what is found in an image; it may take long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A picture of a camera, taken at `t` seconds.

    `pixels` has `channels` bytes per pixel, 1 for gray or 3 for red, green and blue; pages get it in base64.
    """

    camera: str
    t: float
    width: int
    height: int
    channels: int
    pixels: bytes
    found: tuple[Finding, ...]


def picture_of(camera: str, image: Image, find: Find) -> Picture:
    """Return the picture of a whole image for a page, with what is found in it."""
    factor = max(-(-image.width // MAX_WIDTH), -(-image.height // MAX_HEIGHT))
    small = reduced(image, factor)
    found = tuple(_scaled(finding, factor) for finding in find(image))
    return Picture(
        camera=camera,
        t=image.t_ns / 1e9,
        width=small.width,
        height=small.height,
        channels=small.channels,
        pixels=small.pixels,
        found=found,
    )


def reduced(image: Image, factor: int) -> Image:
    """Return every `factor`-th pixel of every `factor`-th row, in gray or in color."""
    channels = image.channels if image.channels == RGB else 1
    if factor == 1 and channels == image.channels:
        return image
    line, width = image.width * image.channels, -(-image.width // factor)
    rows = range(0, image.height, factor)
    pixels = bytearray(len(rows) * width * channels)
    for place, row in enumerate(rows):
        source = image.pixels[row * line : (row + 1) * line]
        begin = place * width * channels
        for channel in range(channels):
            target = slice(begin + channel, begin + width * channels, channels)
            pixels[target] = source[channel :: image.channels * factor]
    return msgspec.structs.replace(
        image, width=width, height=len(rows), channels=channels, pixels=bytes(pixels)
    )


def _scaled(finding: Finding, factor: int) -> Finding:
    corners = tuple(((x + 0.5) / factor - 0.5, (y + 0.5) / factor - 0.5) for x, y in finding.corners)
    return Finding(kind=finding.kind, label=finding.label, corners=corners)


def find_nothing(image: Image) -> tuple[Finding, ...]:
    """Return nothing: the detectors are not installed."""
    return ()


def find_signs(image: Image) -> tuple[Finding, ...]:
    """Return the plates and markers in an image, found as if a level camera had taken it."""
    from colony.runtime.library.camera import array
    from colony.vision.detectors import Detector, detect
    from colony.vision.gray_images import MIN_PIXELS

    if image.channels not in (1, RGB) or min(image.height, image.width) < MIN_PIXELS:
        return ()
    pixels = array(image)
    return tuple(
        Finding(kind=kind, label=found.label, corners=tuple((x, y) for x, y in found.corners))
        for kind, detector in (("plate", Detector.PLATES), ("marker", Detector.MARKERS))
        for found in detect(detector, pixels)
    )


def installed_finder() -> Find:
    """Return the detectors, if the extra `vision` is installed."""
    return find_signs if all(map(installed, EXTRAS["vision"])) else find_nothing
