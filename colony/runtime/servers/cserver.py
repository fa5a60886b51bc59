"""CServer: one camera (thesis section 4.6.4). A robot with several has a server of another name for each.

It grabs an image every period, and returns the newest one, so that no caller waits for a camera. Under its
lock the image is frozen: rows that are grabbed one after the other belong to the same one.

Images do not fit into frames; no sensor binds to a CServer. It answers ticks with empty frames all the same,
which shows the Clock that it is alive.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.runtime.arbitration.locks import LockQueue
from colony.runtime.frames.publishing import FRAMES_KEPT, Publisher
from colony.runtime.library.camera import GrabRows, ImageSize, LockImage, SetPeriod
from colony.runtime.protocol.calls import (
    LATER,
    Asked,
    CallDesk,
    Later,
    Method,
    Nothing,
    RefusedError,
    method,
)
from colony.runtime.protocol.codec import LARGEST
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.images import Image, Shot
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Fetch,
    Malformed,
    Message,
    QuietNode,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.servers.drivers import CameraDriver

CSERVER = "CServer"
"""Name of the only camera; if there are several, the prefix of their names."""

PERIOD_NS = 500_000_000
"""Time from one image to the next in nanoseconds, as in the thesis."""

SHORTEST_PERIOD_NS = 10_000_000
LONGEST_PERIOD_NS = 3_600_000_000_000

_LARGEST_PIXELS = LARGEST - 4096
"""Byte limit of the pixels in one message, which leaves room for the rest of a reply."""


class Camera:
    """A camera as its server keeps it. Mutable: the newest shot, its lock, the period, and `answers`.

    Args:
        address: the server's name.
        driver: the camera.

    Attributes:
        answers: results, or refusals, of calls that waited for the lock; the sender empties the list.
    """

    def __init__(self, address: str, driver: CameraDriver) -> None:
        self.address = address
        self._driver = driver
        self._period_ns = PERIOD_NS
        self._lock = LockQueue()
        self._shot: Shot | None = None
        self._due_ns = 0
        self.answers: list[tuple[Asked, object]] = []

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods of the camera's server."""
        return (
            method("size", Nothing, self._size, right="read"),
            method("grab", Nothing, self._grab, right="read"),
            method("grab_rows", GrabRows, self._grab_rows, right="read"),
            method("lock", LockImage, self._take_lock),
            method("unlock", Nothing, self._give_lock),
            method("period", Nothing, lambda *_: self._period_ns, right="read"),
            method("set_period", SetPeriod, self._set_period),
        )

    @property
    def wake_at(self) -> int | None:
        """The time of the next image, or of the next timeout of a call that waits for the lock."""
        dues = (self._lock.wake_at, self._due_ns if self._lock.holder is None else None)
        return min((due for due in dues if due is not None), default=None)

    def start(self, now_ns: int) -> None:
        """Grab the first image now."""
        self._due_ns = now_ns
        self.tend(now_ns)

    def tend(self, now_ns: int) -> None:
        """Grab an image when it is due, and refuse calls whose wait for the lock timed out."""
        frozen = self._lock.holder is not None and not self.answers  # a grant freezes nothing
        if now_ns >= self._due_ns and not frozen:
            self._shot = self._driver.grab()
            self._due_ns += self._period_ns * (1 + (now_ns - self._due_ns) // self._period_ns)
        self.answers += [(asked, self._lock.refusal()) for asked in self._lock.expire(now_ns)]

    def lost(self, caller: Caller) -> None:
        """Remove a connection that has ended as holder of the lock, and from its queue."""
        self._grant(self._lock.drop(caller))

    def _present(self) -> Shot:
        """Return the shot; if there is none yet, ask the camera once more."""
        if self._shot is None:
            self._shot = self._driver.grab()
        if self._shot is None:
            raise RefusedError("no image", f"{self.address}: the camera has no image to give")
        return self._shot

    def _size(self, asked: Asked, arguments: Nothing, now_ns: int) -> ImageSize:
        shot = self._present()
        return ImageSize(height=shot.height, width=shot.width, channels=shot.channels)

    def _grab(self, asked: Asked, arguments: Nothing, now_ns: int) -> Image:
        shot = self._present()
        return self._sendable(shot.rows(0, shot.height))

    def _grab_rows(self, asked: Asked, arguments: GrabRows, now_ns: int) -> Image:
        try:
            return self._sendable(self._present().rows(arguments.first, arguments.count))
        except ValueError as problem:
            raise RefusedError("arguments", f"{self.address}.grab_rows: {problem}") from None

    def _sendable(self, image: Image) -> Image:
        if len(image.pixels) > _LARGEST_PIXELS:
            found = f"{self.address}: {len(image.pixels)} bytes are too many for one message"
            raise RefusedError("too large", f"{found}; grab rows, {_LARGEST_PIXELS} bytes at most")
        return image

    def _take_lock(self, asked: Asked, arguments: LockImage, now_ns: int) -> Later | None:
        return None if self._lock.ask(asked, now_ns, wait_ns=arguments.wait_ns) else LATER

    def _give_lock(self, asked: Asked, arguments: Nothing, now_ns: int) -> None:
        self._grant(self._lock.release(asked.caller))

    def _grant(self, granted: Iterable[Asked]) -> None:
        self.answers += [(asked, None) for asked in granted]

    def _set_period(self, asked: Asked, arguments: SetPeriod, now_ns: int) -> None:
        period_ns, least, most = arguments.period_ns, SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS
        if not least <= period_ns <= most:
            found = f"{self.address}.set_period: {period_ns / 1e9:g} s"
            raise RefusedError("arguments", f"{found}; expected {least / 1e9:g} to {most / 1e9:g} s")
        self._period_ns = period_ns
        self._due_ns = min(self._due_ns, now_ns + period_ns)


class CServer(QuietNode):
    """The server of a camera. Mutable: the camera's image, its lock, the period.

    Args:
        driver: the camera.
        address: the server's name, an identifier.
        keep: the number of frames kept for readers that missed one.
    """

    def __init__(self, driver: CameraDriver, *, keep: int = FRAMES_KEPT, address: str = CSERVER) -> None:
        self.address = address
        self._camera = Camera(address, driver)
        self._publisher = Publisher(address, lambda tick: {}, keep=keep)
        self._desk = CallDesk(address, self._camera.methods, lost=self._lost)
        self._alarm: int | None = None
        self.listens = (*self._publisher.listens, *self._desk.listens)

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Grab the first image."""
        self._camera.start(now_ns)
        return tuple(self._keep_time(now_ns))

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Answer ticks, fetches and calls, and tend the camera."""
        match message:
            case Tick() | Fetch():
                yield from self._publisher.handle(message)
            case Call() | Alive() | Malformed() | Wake():
                yield from self._desk.handle(message, now_ns)
                self._camera.tend(now_ns)
                yield from self._keep_time(now_ns)
            case _:
                pass

    def _keep_time(self, now_ns: int) -> Iterator[Effect]:
        """Answer the calls that waited for the lock, and schedule the next wake."""
        answers, self._camera.answers = self._camera.answers, []
        yield from self._desk.settle(answers)
        due = self._camera.wake_at
        if due is not None and (self._alarm is None or due < self._alarm or now_ns >= self._alarm):
            self._alarm = due
            yield WakeAt(due)

    def _lost(self, caller: Caller, now_ns: int) -> tuple[Effect, ...]:
        self._camera.lost(caller)
        return ()
