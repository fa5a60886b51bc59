"""PServer: the proximity subsystem, rings of sonars and infrared detectors (thesis section 4.6.2)."""

from __future__ import annotations

import math
from collections.abc import Iterable

from colony.ir.servers import PROXIMITY
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.library.proximity import InfraredReading, SetTimeouts, SonarReading
from colony.runtime.protocol.calls import CallDispatcher, CallId, NoArguments, RefusedError, method
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Fetch,
    Malformed,
    Message,
    QuietNode,
    Sample,
    Tick,
    Wake,
)
from colony.runtime.servers.drivers import ProximityDriver


class PServer(QuietNode):
    """The server of both rings, each with its time of measurement. Mutable.

    A "timeout" is the maximum range of a sonar: longer ranges are clipped to it, in frames and in calls.
    """

    address = PROXIMITY

    def __init__(self, driver: ProximityDriver, *, frames_kept: int = FRAMES_KEPT) -> None:
        self._driver = driver
        self._publisher = Publisher(self.address, self._read, frames_kept=frames_kept)
        self._timeouts: tuple[float, ...] | None = None
        self.methods = (
            method("sonar", NoArguments, self._sonar_reading, right="read"),
            method("infrared", NoArguments, self._infrared_reading, right="read"),
            method("timeouts", NoArguments, lambda *_: self._timeouts, right="read"),
            method("set_timeouts", SetTimeouts, self._set_timeouts),
        )
        self._calls = CallDispatcher(
            self.address, self.methods, other_limit_messages=lambda: self._publisher.limit_messages
        )
        self.listens = (*self._publisher.listens, *self._calls.listens)

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Answer ticks, fetches and calls."""
        match message:
            case Tick() | Fetch():
                return self._publisher.handle(message)
            case Call() | Alive() | Malformed() | Wake():
                return self._calls.handle(message, now_ns)
            case _:
                return ()

    def sonar(self) -> Sample | None:
        """Return the ranges in mm, up to the timeouts, or None."""
        sample = self._driver.sonar()
        if sample is None or self._timeouts is None:
            return sample
        assert isinstance(sample.value, tuple)
        return Sample(tuple(map(min, sample.value, self._timeouts)), sample.t_ns)

    def infrared(self) -> Sample | None:
        """Return bools, True for a detector that sees something, or None."""
        return self._driver.infrared()

    def _read(self, tick: Tick) -> Fields:
        return {"sonar": self.sonar(), "infrared": self.infrared()}

    # --- calls ---------------------------------------------------------------------------------------

    def _sonar_reading(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> SonarReading | None:
        sample = self.sonar()
        if sample is None:
            return None
        assert isinstance(sample.value, tuple)
        return SonarReading(t_ns=sample.t_ns, ranges=tuple(map(float, sample.value)))

    def _infrared_reading(
        self, call_id: CallId, arguments: NoArguments, now_ns: int
    ) -> InfraredReading | None:
        sample = self.infrared()
        if sample is None:
            return None
        assert isinstance(sample.value, tuple)
        return InfraredReading(t_ns=sample.t_ns, seen=tuple(map(bool, sample.value)))

    def _set_timeouts(self, call_id: CallId, arguments: SetTimeouts, now_ns: int) -> None:
        ranges, where = arguments.ranges, f"{self.address}.set_timeouts"
        if len(ranges) != self._driver.count:
            raise RefusedError("arguments", f"{where}: {len(ranges)} ranges; expected {self._driver.count}")
        for sensor, limit in enumerate(ranges):
            if not (math.isfinite(limit) and limit > 0.0):
                raise RefusedError(
                    "arguments", f"{where}: sensor {sensor}: {limit} mm; expected a finite range above 0"
                )
        self._timeouts = ranges
