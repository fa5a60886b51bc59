"""A camera server within one process: CServer without messages (`local_servers.py`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from colony.experiment.local_servers import Granted, Handler
from colony.runtime.arbitration.locks import LockQueue
from colony.runtime.library import camera
from colony.runtime.protocol.calls import LATER, Asked, Later, Nothing, Refused
from colony.runtime.servers.cserver import LONGEST_PERIOD_NS, PERIOD_NS, SHORTEST_PERIOD_NS
from colony.runtime.servers.images import Image
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.drivers import image_of
from colony.sim.world.world import World


class Shot(Protocol):
    """An image that was taken, and may be drawn when somebody wants to see it."""

    @property
    def height(self) -> int: ...

    @property
    def width(self) -> int: ...

    @property
    def channels(self) -> int: ...

    def rows(self, first: int, count: int) -> Image:
        """The band of `count` rows from row `first` on.

        Raises:
            ValueError: the image does not have these rows.
        """
        ...


Shutter = Callable[[int], Shot]
"""Takes an image of the present, which it is told."""


class LocalCamera:
    """A CServer. Mutable: the image, its lock, the period.

    The server grabs an image every period, and everybody gets the newest. Here it is taken when `tend` is
    called at its time, and only what somebody asks to see of it is ever drawn.
    """

    def __init__(self, address: str, shutter: Shutter) -> None:
        self.address = address
        self._shutter = shutter
        self._shot: Shot | None = None
        self._period_ns = PERIOD_NS
        self._due_ns = 0
        self._lock = LockQueue()
        self.granted: Granted = []
        self.handlers: Mapping[str, Handler] = {
            "size": self._size,
            "grab": self._grab,
            "grab_rows": self._grab_rows,
            "lock": self._take_lock,
            "unlock": self._give_lock,
            "period": lambda *_: self._period_ns,
            "set_period": self._set_period,
        }

    def tend(self, now_ns: int) -> None:
        """Grab when it is time; refuse those who waited long enough for the lock."""
        if self._lock.holder is None and now_ns >= self._due_ns:
            self._shot = self._shutter(now_ns)
            self._due_ns += self._period_ns * (1 + (now_ns - self._due_ns) // self._period_ns)
        due = self._lock.wake_at
        if due is not None and now_ns >= due:
            self.granted += [(asked, self._lock.refusal()) for asked in self._lock.expire(now_ns)]

    def _present(self, now_ns: int) -> Shot:
        if self._shot is None:
            self._shot = self._shutter(now_ns)
        return self._shot

    def _size(self, asked: Asked, arguments: Nothing, reply: Any, now_ns: int) -> camera.ImageSize:
        image = self._present(now_ns)
        return camera.ImageSize(height=image.height, width=image.width, channels=image.channels)

    def _grab(self, asked: Asked, arguments: Nothing, reply: Any, now_ns: int) -> Image:
        shot = self._present(now_ns)
        return shot.rows(0, shot.height)

    def _grab_rows(self, asked: Asked, arguments: camera.GrabRows, reply: Any, now_ns: int) -> Image:
        try:
            return self._present(now_ns).rows(arguments.first, arguments.count)
        except ValueError as problem:
            raise Refused("arguments", f"{self.address}.grab_rows: {problem}") from None

    def _take_lock(self, asked: Asked, arguments: camera.LockImage, reply: Any, now_ns: int) -> Later | None:
        return None if self._lock.ask(asked, now_ns, wait_ns=arguments.wait_ns) else LATER

    def _give_lock(self, asked: Asked, arguments: Nothing, reply: Any, now_ns: int) -> None:
        self.granted += [(granted, None) for granted in self._lock.release(asked.caller)]
        self.tend(now_ns)

    def _set_period(self, asked: Asked, arguments: camera.SetPeriod, reply: Any, now_ns: int) -> None:
        period_ns, least, most = arguments.period_ns, SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS
        if not least <= period_ns <= most:
            found = f"{self.address}.set_period: {period_ns / 1e9:g} s"
            raise Refused("arguments", f"{found}; expected {least / 1e9:g} to {most / 1e9:g} s")
        self._period_ns = period_ns
        self._due_ns = min(self._due_ns, now_ns + period_ns)


class CeilingShot:
    """What the camera of robot 0 saw of the ceiling at `t_ns`, drawn row by row as it is wanted."""

    channels = 1

    def __init__(self, ceiling: CeilingCamera, world: World, t_ns: int) -> None:
        self._ceiling = ceiling
        self._pose = world.true_pose(0)
        self._t_ns = t_ns
        self.height, self.width = ceiling.config.height, ceiling.config.width

    def rows(self, first: int, count: int) -> Image:
        if first < 0 or count <= 0 or first + count > self.height:
            raise ValueError(
                f"{count} rows from row {first} on; expected at least 1 of rows 0 to {self.height - 1}"
            )
        pixels = self._ceiling.rows(self._pose, self._t_ns, range(first, first + count))
        return image_of(pixels, self._t_ns, first)


class LevelShot:
    """What a camera of robot 0 saw that looks along the floor, at `t_ns`: drawn as it is wanted, and only the
    rows that are.

    Robots, people and doors are remembered as they were when the shot was taken.
    """

    channels = 1

    def __init__(self, camera: Camera, world: World, t_ns: int) -> None:
        self._draw = camera.shot(world, 0, t_ns)
        self._t_ns = t_ns
        self.height, self.width = camera.config.height, camera.config.width

    def rows(self, first: int, count: int) -> Image:
        return image_of(self._draw(first, count), self._t_ns, first)
