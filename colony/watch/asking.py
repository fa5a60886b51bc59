"""Asking a robot for what frames do not have, while a page is open: pictures, and the estimate of its pose.

A thread asks, a few times a second at most, with calls that need the right to read. Without a page it sends
the robot nothing, and has no connection to it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from colony.ir.servers import DSERVER
from colony.nav.pose.pose import pose_of
from colony.nav.shared import POSE
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import camera, data
from colony.runtime.protocol.images import Image
from colony.runtime.servers.cserver import CSERVER
from colony.watch.ellipse import PoseEllipse, ellipse_of
from colony.watch.pictures import Find, Picture, picture_of

ASK_INTERVAL_S = 0.5
"""Seconds between two questions, at least: the period of a camera, unless something sets it."""

ANSWER_TIMEOUT_S = 1.0
"""Maximum seconds to wait for a camera."""

MAX_CAMERAS = 4
"""Maximum number of cameras that are shown, in the order of their names."""

MAX_IMAGE_BYTES = 2**24
"""Maximum size of an image; larger ones are not read."""

BAND_BYTES = 2**20
"""Maximum size of the rows that are read with one call."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What a robot answered: its cameras' pictures, and where its pose estimator believes it, if one runs."""

    pictures: tuple[Picture, ...]
    ellipse: PoseEllipse | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What a robot answered, by the number of the question."""

    number: int
    seen: Seen


Ask = Callable[[], Seen]
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


class Connections:
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
    connections = Connections(session)

    def ask() -> Seen:
        names = connections.servers()
        return Seen(pictures=tuple(_pictures(connections, names, find)), ellipse=_ellipse(connections, names))

    try:
        yield ask
    finally:
        connections.close()


def _pictures(connections: Connections, names: tuple[str, ...], find: Find) -> Iterator[Picture]:
    """Yield the pictures of the cameras that have one."""
    cameras = [name for name in names if name.startswith(CSERVER) and "/" not in name]
    for name in cameras[:MAX_CAMERAS]:
        with suppress(RobotConnectionError):
            if (image := whole_image(connections.to(name))) is not None:
                yield picture_of(name, image, find)


def _ellipse(connections: Connections, names: tuple[str, ...]) -> PoseEllipse | None:
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
