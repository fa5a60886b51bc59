"""RServer: the base of the robot (thesis section 4.6.3). It alone moves it, by one command a frame.

A watchdog stands behind the arbitration: when the ticks stop, so that no frame is decided any more, the base
is stopped after `watchdog_ns`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.ir.types import ScalarValue
from colony.runtime import topics
from colony.runtime.arbitration import Timing
from colony.runtime.drivers import BaseDriver
from colony.runtime.fields import RSERVER
from colony.runtime.messages import Effect, Fetch, Message, Request, Sample, Tick, Wake, WakeAt
from colony.runtime.servers.commanding import CommandDesk, Commanded
from colony.runtime.servers.publishing import Fields, Publisher


class RServer:
    """Publishes the state of the base and arbitrates who drives it. Mutable: the settings sent last."""

    address = RSERVER.name

    def __init__(
        self,
        driver: BaseDriver,
        commanded: tuple[Commanded, ...],
        *,
        times: Timing,
        watchdog_ns: int,
        keep: int,
    ) -> None:
        self._driver = driver
        self._publisher = Publisher(self.address, self._read, keep=keep)
        self._desk = CommandDesk(commanded, times, self._drive)
        self._watchdog_ns = watchdog_ns
        self._commanded_at: int | None = None
        self._bark_at: int | None = None
        self._setting = (0.0, 0.0)
        self.listens = (*self._publisher.listens, topics.requests(self.address))

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        match message:
            case Tick():
                yield from self._publisher.handle(message)
                yield from self._desk.tick(message, now_ns)
            case Fetch():
                yield from self._publisher.handle(message)
            case Request():
                yield from self._desk.request(message, now_ns)
            case Wake():
                yield from self._desk.wake(now_ns)
            case _:
                return
        yield from self._watch(now_ns)

    def close(self) -> None:
        """Stop the base."""
        self._halt()

    def _halt(self) -> None:
        self._commanded_at = self._bark_at = None
        self._setting = (0.0, 0.0)
        self._driver.stop()

    def _watch(self, now_ns: int) -> Iterator[Effect]:
        """Stop a base that nobody commands any more; while one does, one wake for this is on its way."""
        if self._commanded_at is None:
            return
        due = self._commanded_at + self._watchdog_ns
        if now_ns >= due:
            self._halt()
        elif self._bark_at is None or now_ns >= self._bark_at:
            self._bark_at = due
            yield WakeAt(due)

    def _drive(self, commanded: Commanded, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        velocity, turn = (
            0.0 if place is None else float(values[place]) for place in commanded.binding.places
        )
        self._driver.drive(velocity, turn)
        self._setting = (velocity, turn)
        self._commanded_at = now_ns

    def _read(self, tick: Tick) -> Fields:
        speed_setting, turn_setting = self._setting
        settings = {
            "speed_setting": Sample(speed_setting, tick.t_ns),
            "turn_setting": Sample(turn_setting, tick.t_ns),
        }
        state = self._driver.state()
        if state is None:
            return settings
        t = state.t_ns
        return {
            "bumper": Sample(state.front_bumper or state.rear_bumper, t),
            "front_bumper": Sample(state.front_bumper, t),
            "rear_bumper": Sample(state.rear_bumper, t),
            "x": Sample(state.x, t),
            "y": Sample(state.y, t),
            "heading": Sample(state.heading, t),
            "speed": Sample(state.speed, t),
            "turn_rate": Sample(state.turn_rate, t),
            "wheel_speed": Sample(state.wheel_speed, t),
            **settings,
        }
