"""What can be asked of a CServer: its image, whole or in part, and to keep it (thesis section 4.6.4).

image = connection.do(camera.grab())
pixels = camera.array(image)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import Nothing
from colony.runtime.protocol.images import Image

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_MARGIN_S = 1.0
"""For how much longer than the server a caller waits for a lock."""


class ImageSize(msgspec.Struct, frozen=True, kw_only=True):
    """The size of a camera's images, in rows, columns and bytes a pixel."""

    height: int
    width: int
    channels: int


class GrabRows(msgspec.Struct, frozen=True, kw_only=True):
    """`grab_rows`: `count` rows from row `first` on; 0 is the top one."""

    first: int
    count: int = 1


class LockImage(msgspec.Struct, frozen=True, kw_only=True):
    """`lock`: for how long to wait where somebody else has the lock; 0 is not at all."""

    wait_ns: int = 0


class SetPeriod(msgspec.Struct, frozen=True, kw_only=True):
    """`set_period`: the time from one image to the next."""

    period_ns: int


def size() -> Ask[ImageSize]:
    """The size of the images (`CameraGetSize`)."""
    return Ask("size", Nothing(), ImageSize, "read", repeatable=True)


def grab() -> Ask[Image]:
    """The image that the server grabbed last; it is up to a period old (`CameraGrab`)."""
    return Ask("grab", Nothing(), Image, "read", repeatable=True)


def grab_rows(first: int, count: int = 1) -> Ask[Image]:
    """A band of that image (`CameraGrabRow`). Bands with the same `t_ns` are of the same image; under the
    lock all are."""
    return Ask("grab_rows", GrabRows(first=first, count=count), Image, "read", repeatable=True)


def lock(wait_s: float = 0.0) -> Ask[None]:
    """Keep the image from being replaced until `unlock`, or until this connection ends (`CameraLock`).

    Where somebody else keeps it, the call waits for `wait_s`, behind those of higher priority, and is then
    refused with the code "locked".
    """
    asked = LockImage(wait_ns=round(wait_s * 1e9))
    return Ask("lock", asked, type(None), "command", wait_s=wait_s + _MARGIN_S if wait_s > 0 else None)


def unlock() -> Ask[None]:
    """Let the image be replaced again (`CameraUnLock`)."""
    return Ask("unlock", Nothing(), type(None), "command")


def period() -> Ask[int]:
    """The time from one image to the next, in nanoseconds."""
    return Ask("period", Nothing(), int, "read", repeatable=True)


def set_period(seconds: float) -> Ask[None]:
    """Set the time from one image to the next; it holds for everybody, until the server ends."""
    return Ask(
        "set_period", SetPeriod(period_ns=round(seconds * 1e9)), type(None), "command", repeatable=True
    )


def array(image: Image) -> NDArray[np.uint8]:
    """An image as a read-only array: (height, width) where it has one channel, else (height, width,
    channels)."""
    import numpy as np

    shape = (image.height, image.width, image.channels)
    return np.frombuffer(image.pixels, dtype=np.uint8).reshape(shape[:2] if image.channels == 1 else shape)
