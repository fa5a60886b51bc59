"""CServer: the server of one camera (thesis section 4.6.4). Each camera of a robot has its own.

The server grabs an image every period and returns the newest one, so no caller waits for the camera. While a
connection holds the lock, the image is frozen: rows grabbed one after another belong to the same image.

Images do not fit into frames, and no sensor can be bound to a CServer. It answers ticks with empty frames,
which show the Clock that it is alive.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.runtime.arbitration.outside import LockQueue
from colony.runtime.frames.publishing import FRAMES_KEPT, Publisher
from colony.runtime.library.camera import GrabRows, ImageSize, LockImage, SetPeriod
from colony.runtime.protocol.calls import (
    LATER,
    CallDispatcher,
    CallId,
    Later,
    Method,
    NoArguments,
    RefusedError,
    method,
)
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
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
    WakeSchedule,
)
from colony.runtime.servers.drivers import CameraDriver

CSERVER = "CServer"
"""Name of the server of a single camera; with several cameras, the prefix of their servers' names."""

PERIOD_NS = 500_000_000
"""Time from one image to the next in nanoseconds, as in the thesis."""

MIN_PERIOD_NS = 10_000_000
MAX_PERIOD_NS = 3_600_000_000_000

_MAX_PIXEL_BYTES = MAX_MESSAGE_BYTES - 4096
"""Byte limit of the pixels in one message; the remainder is for the other fields of the reply."""


class SharedCamera:
    """A camera: its newest shot, its lock and its period. Mutable.

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
        self.answers: list[tuple[CallId, object]] = []

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods of the camera's server."""
        return (
            method("size", NoArguments, self._size, right="read"),
            method("grab", NoArguments, self._grab, right="read"),
            method("grab_rows", GrabRows, self._grab_rows, right="read"),
            method("lock", LockImage, self._acquire_lock),
            method("unlock", NoArguments, self._release_lock),
            method("period", NoArguments, lambda *_: self._period_ns, right="read"),
            method("set_period", SetPeriod, self._set_period),
        )

    @property
    def wake_at(self) -> int | None:
        """The time of the next image, or of the next timeout of a call waiting for the lock."""
        due_times = (self._lock.wake_at, self._due_ns if self._lock.holder is None else None)
        return min((due for due in due_times if due is not None), default=None)

    def start(self, now_ns: int) -> None:
        """Grab the first image now."""
        self._due_ns = now_ns
        self.poll(now_ns)

    def poll(self, now_ns: int) -> None:
        """Grab an image if one is due, and refuse calls whose wait for the lock timed out."""
        # a lock that is just being granted does not freeze the image yet
        frozen = self._lock.holder is not None and not self.answers
        if now_ns >= self._due_ns and not frozen:
            self._shot = self._driver.grab()
            self._due_ns += self._period_ns * (1 + (now_ns - self._due_ns) // self._period_ns)
        self.answers += [(call_id, self._lock.refusal()) for call_id in self._lock.expire(now_ns)]

    def on_lost(self, caller: Caller) -> None:
        """Release the lock of a connection that has ended, and remove the connection from the queue."""
        self._grant(self._lock.drop(caller))

    def _require_shot(self) -> Shot:
        """Return the newest shot; if there is none yet, try the camera once more."""
        if self._shot is None:
            self._shot = self._driver.grab()
        if self._shot is None:
            raise RefusedError("no image", f"{self.address}: the camera has no image yet")
        return self._shot

    def _size(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> ImageSize:
        shot = self._require_shot()
        return ImageSize(height=shot.height, width=shot.width, channels=shot.channels)

    def _grab(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> Image:
        shot = self._require_shot()
        return self._sendable(shot.rows(0, shot.height))

    def _grab_rows(self, call_id: CallId, arguments: GrabRows, now_ns: int) -> Image:
        try:
            return self._sendable(self._require_shot().rows(arguments.first, arguments.count))
        except ValueError as problem:
            raise RefusedError("arguments", f"{self.address}.grab_rows: {problem}") from None

    def _sendable(self, image: Image) -> Image:
        if len(image.pixels) > _MAX_PIXEL_BYTES:
            found = f"{self.address}: {len(image.pixels)} bytes of pixels do not fit into one message"
            raise RefusedError("too large", f"{found}; grab rows of at most {_MAX_PIXEL_BYTES} bytes")
        return image

    def _acquire_lock(self, call_id: CallId, arguments: LockImage, now_ns: int) -> Later | None:
        return None if self._lock.acquire(call_id, now_ns, wait_ns=arguments.wait_ns) else LATER

    def _release_lock(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> None:
        self._grant(self._lock.release(call_id.caller))

    def _grant(self, granted: Iterable[CallId]) -> None:
        self.answers += [(call_id, None) for call_id in granted]

    def _set_period(self, call_id: CallId, arguments: SetPeriod, now_ns: int) -> None:
        period_ns = arguments.period_ns
        if not MIN_PERIOD_NS <= period_ns <= MAX_PERIOD_NS:
            found = f"{self.address}.set_period: {period_ns / 1e9:g} s"
            expected = f"{MIN_PERIOD_NS / 1e9:g} to {MAX_PERIOD_NS / 1e9:g} s"
            raise RefusedError("arguments", f"{found}; expected {expected}")
        self._period_ns = period_ns
        self._due_ns = min(self._due_ns, now_ns + period_ns)


class CServer(QuietNode):
    """The server of a camera. Mutable.

    Args:
        driver: the camera.
        address: the server's name, an identifier.
        frames_kept: the number of frames kept for readers that missed one.
    """

    def __init__(
        self, driver: CameraDriver, *, frames_kept: int = FRAMES_KEPT, address: str = CSERVER
    ) -> None:
        self.address = address
        self._camera = SharedCamera(address, driver)
        self._publisher = Publisher(address, lambda tick: {}, frames_kept=frames_kept)
        self._calls = CallDispatcher(address, self._camera.methods, on_lost=self._lost)
        self._wakes = WakeSchedule()
        self.listens = (*self._publisher.listens, *self._calls.listens)

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Grab the first image."""
        self._camera.start(now_ns)
        return tuple(self._settle(now_ns))

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Answer ticks, fetches and calls, and poll the camera."""
        match message:
            case Tick() | Fetch():
                yield from self._publisher.handle(message)
            case Call() | Alive() | Malformed() | Wake():
                yield from self._calls.handle(message, now_ns)
                self._camera.poll(now_ns)
                yield from self._settle(now_ns)
            case _:
                pass

    def _settle(self, now_ns: int) -> Iterator[Effect]:
        """Answer the calls that waited for the lock, and schedule the next wake."""
        answers, self._camera.answers = self._camera.answers, []
        yield from self._calls.settle(answers)
        yield from self._wakes.request(self._camera.wake_at, now_ns)

    def _lost(self, caller: Caller, now_ns: int) -> tuple[Effect, ...]:
        self._camera.on_lost(caller)
        return ()
