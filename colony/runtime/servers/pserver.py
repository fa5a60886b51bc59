"""PServer: the proximity subsystem, 24 sonars and 24 infrared detectors (thesis section 4.6.2)."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime.drivers import ProximityDriver
from colony.runtime.fields import PSERVER
from colony.runtime.messages import Effect, Fetch, Message, Tick
from colony.runtime.servers.publishing import Fields, Publisher


class PServer:
    """Publishes both rings each frame, each with the time at which it was measured."""

    address = PSERVER.name

    def __init__(self, driver: ProximityDriver, *, keep: int) -> None:
        self._driver = driver
        self._publisher = Publisher(self.address, self._read, keep=keep)
        self.listens = self._publisher.listens

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, (Tick, Fetch)):
            return self._publisher.handle(message)
        return ()

    def close(self) -> None:
        """It holds nothing."""

    def _read(self, tick: Tick) -> Fields:
        return {"sonar": self._driver.sonar(), "infrared": self._driver.infrared()}
