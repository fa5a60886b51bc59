"""Asking a robot for what frames do not have, while a page is open: pictures, its pose, and what fails.

A thread asks, a few times a second at most, with calls that need the right to read. Without a page it sends
the robot nothing, and has no connection to it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import msgspec

from colony.extras import EXTRAS, installed
from colony.ir.servers import DSERVER
from colony.nav.pose.pose import PoseEstimate, pose_of
from colony.nav.shared import POSE
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import camera, data
from colony.runtime.library.ask import STATUS
from colony.runtime.library.leader import LEADER, run_status
from colony.runtime.protocol.images import Image
from colony.runtime.protocol.topics import OBSERVER
from colony.runtime.servers.cserver import CSERVER

# --- ellipse -------------------------------------------------------------------------------------------
#
# The ellipse of a pose on the map, from its covariance.


STANDARD_DEVIATIONS = math.sqrt(-2.0 * math.log(0.05))
"""Semiaxes in standard deviations: the robot is in the ellipse with a probability of 95 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseEllipse:
    """Where a robot is with a probability of 95 %, in the map: x east and y north.

    Attributes:
        t: time of the estimate in seconds.
        x: center, in mm.
        y: center, in mm.
        major: longer semiaxis, in mm.
        minor: shorter semiaxis, in mm.
        direction: direction of the longer semiaxis, in degrees counterclockwise from east.
        heading: heading, in degrees counterclockwise from north.
        sigma_deg: standard deviation of the heading, in degrees.
    """

    t: float
    x: float
    y: float
    major: float
    minor: float
    direction: float
    heading: float
    sigma_deg: float


def ellipse_of(pose: PoseEstimate) -> PoseEllipse:
    """Return the ellipse of a pose: along the eigenvectors of the covariance of its position."""
    middle, half = (pose.xx + pose.yy) / 2.0, math.hypot((pose.xx - pose.yy) / 2.0, pose.xy)
    return PoseEllipse(
        t=pose.t_ns / 1e9,
        x=pose.x_mm,
        y=pose.y_mm,
        major=STANDARD_DEVIATIONS * math.sqrt(max(middle + half, 0.0)),
        minor=STANDARD_DEVIATIONS * math.sqrt(max(middle - half, 0.0)),
        direction=math.degrees(math.atan2(2.0 * pose.xy, pose.xx - pose.yy) / 2.0),
        heading=pose.heading_deg,
        sigma_deg=pose.sigma_deg,
    )


# --- pictures ------------------------------------------------------------------------------------------
#
# Pictures of a robot's cameras for pages: reduced, with what the detectors find in them.


MAX_WIDTH, MAX_HEIGHT = 320, 240
"""Maximum size of a picture in pixels; larger images are reduced by a whole factor."""

RGB = 3
"""Channels of a colored image; with any other number the first channel is shown, in gray."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectedObject:
    """What a detector found: a plate or a marker.

    Attributes:
        kind: the kind of detector.
        label: text of a plate, "" if it cannot be read; bits of a marker.
        corners: corners clockwise from the upper left, in pixels; pixel i extends from i - 0.5 to i + 0.5.
    """

    kind: str
    label: str
    corners: tuple[tuple[float, float], ...]


Find = Callable[[Image], tuple[DetectedObject, ...]]
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
    found: tuple[DetectedObject, ...]


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


def _scaled(finding: DetectedObject, factor: int) -> DetectedObject:
    corners = tuple(((x + 0.5) / factor - 0.5, (y + 0.5) / factor - 0.5) for x, y in finding.corners)
    return DetectedObject(kind=finding.kind, label=finding.label, corners=corners)


def find_nothing(image: Image) -> tuple[DetectedObject, ...]:
    """Return nothing: the detectors are not installed."""
    return ()


def find_signs(image: Image) -> tuple[DetectedObject, ...]:
    """Return the plates and markers in an image, found as if a level camera had taken it."""
    from colony.runtime.library.camera import array
    from colony.vision.detectors import Detector, detect
    from colony.vision.gray_images import MIN_PIXELS

    if image.channels not in (1, RGB) or min(image.height, image.width) < MIN_PIXELS:
        return ()
    pixels = array(image)
    return tuple(
        DetectedObject(kind=kind, label=found.label, corners=tuple((x, y) for x, y in found.corners))
        for kind, detector in (("plate", Detector.PLATES), ("marker", Detector.MARKERS))
        for found in detect(detector, pixels)
    )


def installed_finder() -> Find:
    """Return the detectors, if the extra `vision` is installed."""
    return find_signs if all(map(installed, EXTRAS["vision"])) else find_nothing


# --- asking --------------------------------------------------------------------------------------------


ASK_INTERVAL_S = 0.5
"""Seconds between two questions, at least: the period of a camera, unless something sets it."""

ANSWER_TIMEOUT_S = 1.0
"""Maximum seconds to wait for a camera."""

TROUBLES_INTERVAL_S = 2.0
"""Seconds between two questions for what fails, at least."""

MAX_CAMERAS = 4
"""Maximum number of cameras that are shown, in the order of their names."""

MAX_IMAGE_BYTES = 2**24
"""Maximum size of an image; larger ones are not read."""

BAND_BYTES = 2**20
"""Maximum size of the rows that are read with one call."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotView:
    """What a robot answered.

    Attributes:
        pictures: its cameras' pictures.
        ellipse: where its pose estimator believes it, if one runs.
        troubles: failing parts of its servers, and the reason why nothing moves, as in `colony ps`.
    """

    pictures: tuple[Picture, ...]
    ellipse: PoseEllipse | None
    troubles: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What a robot answered, by the number of the question."""

    number: int
    seen: RobotView


Ask = Callable[[], RobotView]
"""Function that asks once; it may block."""


class Asker:
    """Asks while at least one page is open. Mutable; threads may share it.

    Args:
        asking: opens what the questions need, and gives the function that asks.
        interval_s: seconds between two questions.
    """

    def __init__(
        self, asking: Callable[[], AbstractContextManager[Ask]], interval_s: float = ASK_INTERVAL_S
    ) -> None:
        self._asking, self._interval_s = asking, interval_s
        self._pages = 0
        self._is_closed = False
        self._changed = threading.Condition()
        self.answers: Answers | None = None
        """The newest answers; None before the first, and without a page."""
        self._thread = threading.Thread(target=self._run, name="asker", daemon=True)
        self._thread.start()

    @contextmanager
    def page(self) -> Iterator[None]:
        """Ask as long as the context lasts: a page is open."""
        self._count(1)
        try:
            yield
        finally:
            self._count(-1)

    def close(self) -> None:
        """Ask no more. Idempotent."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        self._thread.join()

    def _count(self, pages: int) -> None:
        with self._changed:
            self._pages += pages
            self._changed.notify()

    def _is_wanted(self) -> bool:
        return self._is_closed or self._pages > 0

    def _run(self) -> None:
        number = 0
        while True:
            with self._changed:
                self._changed.wait_for(self._is_wanted)
                if self._is_closed:
                    return
            with self._asking() as ask:
                while self._goes_on(number):
                    number += 1
                    self.answers = Answers(number=number, seen=ask())
            self.answers = None

    def _goes_on(self, number: int) -> bool:
        """Wait for the time of the next question; return False if nobody wants an answer any more."""
        with self._changed:
            if self.answers is not None:
                self._changed.wait_for(lambda: self._is_closed or not self._pages, self._interval_s)
            return not self._is_closed and self._pages > 0


class PageConnections:
    """The connections of a page's questions, by server, opened as they are needed. Mutable."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._open: dict[str, Connection] = {}

    def servers(self) -> tuple[str, ...]:
        """Return the servers that are up; connections to others are closed."""
        names = self._session.servers()
        for gone in self._open.keys() - set(names):
            self._open.pop(gone).close()
        return names

    def to(self, server: str) -> Connection:
        """Return the connection to a server.

        Raises:
            RobotConnectionError: it cannot be opened.
        """
        if server not in self._open:
            self._open[server] = self._session.connect(
                server, name="colony watch", timeout_s=ANSWER_TIMEOUT_S
            )
        return self._open[server]

    def close(self) -> None:
        """Close all of them."""
        for connection in self._open.values():
            connection.close()


@contextmanager
def asking_robot(session: Session, find: Find) -> Iterator[Ask]:
    """Ask a robot as long as the context lasts; its value asks once.

    Args:
        session: a session with the robot.
        find: the detectors to run on the pictures.
    """
    connections = PageConnections(session)
    due_s = 0.0
    troubles: tuple[str, ...] = ()

    def ask() -> RobotView:
        nonlocal due_s, troubles
        names = connections.servers()
        if time.monotonic() >= due_s:
            troubles = tuple(_troubles(connections, names))
            due_s = time.monotonic() + TROUBLES_INTERVAL_S
        return RobotView(
            pictures=tuple(_pictures(connections, names, find)),
            ellipse=_ellipse(connections, names),
            troubles=troubles,
        )

    try:
        yield ask
    finally:
        connections.close()


def _pictures(connections: PageConnections, names: tuple[str, ...], find: Find) -> Iterator[Picture]:
    """Yield the pictures of the cameras that have one."""
    cameras = [name for name in names if name.startswith(CSERVER) and "/" not in name]
    for name in cameras[:MAX_CAMERAS]:
        with suppress(RobotConnectionError):
            if (image := whole_image(connections.to(name))) is not None:
                yield picture_of(name, image, find)


def _troubles(connections: PageConnections, names: tuple[str, ...]) -> Iterator[str]:
    for name in names:
        with suppress(RobotConnectionError):
            if name == LEADER:
                still = connections.to(name).do(run_status()).still
                yield from (f"nothing moves: {still}",) if still else ()
            elif "/" not in name and name != OBSERVER:
                yield from (f"{name}: {part}" for part in connections.to(name).do(STATUS).failing)


def _ellipse(connections: PageConnections, names: tuple[str, ...]) -> PoseEllipse | None:
    """Return the ellipse of the pose that the robot's estimator published; None without one."""
    if DSERVER.name not in names:
        return None
    value: Any = None
    with suppress(RobotConnectionError):
        value = connections.to(DSERVER.name).do(data.get(POSE))
    pose = pose_of(value)
    return None if pose is None else ellipse_of(pose)


def whole_image(connection: Connection) -> Image | None:
    """Read the newest image of a camera; None if it is too large, empty, or changed while it was read.

    Raises:
        RobotConnectionError: the camera refuses, or does not answer.
    """
    size = connection.do(camera.size())
    line = size.width * size.channels
    if min(size.height, size.width, size.channels) <= 0 or size.height * line > MAX_IMAGE_BYTES:
        return None
    rows = max(1, BAND_BYTES // line)
    bands = [
        connection.do(camera.grab_rows(first, min(rows, size.height - first)))
        for first in range(0, size.height, rows)
    ]
    shape = {(band.t_ns, band.width, band.channels) for band in bands}
    if len(shape) > 1 or sum(band.height for band in bands) != size.height:
        return None
    return Image(
        t_ns=bands[0].t_ns,
        height=size.height,
        width=bands[0].width,
        channels=bands[0].channels,
        pixels=b"".join(band.pixels for band in bands),
    )
