"""Calls of a CServer: read its image, whole or in part, and lock it (thesis section 4.6.4).

image = connection.do(camera.grab())
pixels = camera.array(image)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.images import Image

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_MARGIN_S = 1.0
"""Seconds by which a caller's wait for a lock exceeds the server's."""


class ImageSize(msgspec.Struct, frozen=True, kw_only=True):
    """Size of a camera's images, in rows, columns and bytes per pixel."""

    height: int
    width: int
    channels: int


class GrabRows(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `grab_rows`: `count` rows, beginning with row `first`; row 0 is at the top."""

    first: int
    count: int = 1


class LockImage(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `lock`: the maximum time to wait for the lock; 0 to not wait."""

    wait_ns: int = 0


class SetPeriod(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `set_period`: the time from one image to the next."""

    period_ns: int


def size() -> CallRequest[ImageSize]:
    """Read the size of the images (`CameraGetSize`)."""
    return CallRequest("size", NoArguments(), ImageSize, "read", repeatable=True)


def grab() -> CallRequest[Image]:
    """Read the newest image, which is up to one period old (`CameraGrab`)."""
    return CallRequest("grab", NoArguments(), Image, "read", repeatable=True)


def grab_rows(first: int, count: int = 1) -> CallRequest[Image]:
    """Read a band of rows of the newest image (`CameraGrabRow`).

    Bands with the same `t_ns` are of the same image. All bands read while holding the lock are of one image.
    """
    return CallRequest("grab_rows", GrabRows(first=first, count=count), Image, "read", repeatable=True)


def lock(wait_s: float = 0.0) -> CallRequest[None]:
    """Keep the image from being replaced until `unlock`, or until this connection ends (`CameraLock`).

    If another connection holds the lock, the call waits up to `wait_s`, behind connections of higher
    priority, and is then refused with the code "locked".
    """
    arguments = LockImage(wait_ns=round(wait_s * 1e9))
    return CallRequest(
        "lock", arguments, type(None), "command", wait_s=wait_s + _MARGIN_S if wait_s > 0 else None
    )


def unlock() -> CallRequest[None]:
    """Let the image be replaced again (`CameraUnLock`)."""
    return CallRequest("unlock", NoArguments(), type(None), "command")


def period() -> CallRequest[int]:
    """Read the time from one image to the next, in nanoseconds."""
    return CallRequest("period", NoArguments(), int, "read", repeatable=True)


def set_period(seconds: float) -> CallRequest[None]:
    """Set the time from one image to the next, for all connections, until the server ends."""
    return CallRequest(
        "set_period", SetPeriod(period_ns=round(seconds * 1e9)), type(None), "command", repeatable=True
    )


def array(image: Image) -> NDArray[np.uint8]:
    """Return an image as a read-only array.

    Its shape is (height, width) for one channel, else (height, width, channels).
    """
    import numpy as np

    shape = (image.height, image.width, image.channels)
    return np.frombuffer(image.pixels, dtype=np.uint8).reshape(shape[:2] if image.channels == 1 else shape)
