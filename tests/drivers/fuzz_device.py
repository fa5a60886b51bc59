"""Fuzzing of dialects: what came out of damaged streams is read as packets of the device.

No packet may raise anything but a refusal; what is measured afterwards lies within what the device can
physically measure, as it is written here a second time; and what the opening dialogue sends, whatever it is
answered, moves no base.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from colony.drivers.dialect import REFUSALS, Dialect, OpeningError, OpeningRun
from colony.drivers.line import Measurements
from colony.ir.types import ScalarValue
from colony.runtime.servers.drivers import BaseState

SLACK_S = 0.3
"""Seconds by which the times of two packets may be wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Device:
    """A device whose dialect is fuzzed.

    Attributes:
        dialect: makes the dialect.
        recording: returns the bytes of packets that an emulated device sent, oldest first.
        period_s: seconds between two of them.
        limits: least and greatest value of fields and of elements of rings.
        max_speed, max_turn: greatest speeds in mm/s and deg/s, in any direction.
        moves: returns True if these bytes move the device, which may drive and stands.
    """

    dialect: Callable[[], Dialect[Any]]
    recording: Callable[[], list[bytes]]
    period_s: float
    limits: Mapping[str, tuple[float, float]]
    max_speed: float
    max_turn: float
    moves: Callable[[bytes], bool]


@dataclass(slots=True)
class Trial:
    """What the dialect made of streams. Mutable: sums, and the line as it is.

    Attributes:
        read: packets that were read.
        refused: packets that were refused, because the device cannot measure that.
        lost: packets after which the line was given up, and begun again.
        opened: openings that were answered to the end.
        sent: bytes that openings sent.
    """

    device: Device
    rng: random.Random
    read: int = 0
    refused: int = 0
    lost: int = 0
    opened: int = 0
    sent: int = 0
    _now_ns: int = 0
    _dialect: Dialect[Any] = field(init=False)
    _measured: Measurements = field(init=False)
    _opening: OpeningRun[Any] = field(init=False)
    _base: BaseState | None = None

    def __post_init__(self) -> None:
        """Begin."""
        self._start()

    def __str__(self) -> str:
        """Return the figures in a line."""
        return (
            f"{self.read} packets read, {self.refused} refused, {self.lost} lost the line; "
            f"{self.opened} openings ended, which sent {self.sent} bytes"
        )

    def take(self, packets: Sequence[Any]) -> None:
        """Read packets of one stream."""
        for packet in packets:
            self._now_ns += round(self.device.period_s * 1e9)
            try:
                self._take(packet)
            except OpeningError:
                self.lost += 1
                self._start()

    def _start(self) -> None:
        """Begin the line again, with a new dialect: a driver that is started again."""
        self._dialect = dialect = self.device.dialect()
        self._measured = Measurements(
            rings=dialect.rings,
            bounds=dialect.bounds,
            max_speed=dialect.max_speed,
            max_turn=dialect.max_turn,
        )
        self._base = None
        self._open()

    def _open(self) -> None:
        self._dialect.restart()
        self._opening = OpeningRun(self._dialect.opening(), self._send, self._now_ns)

    def _take(self, packet: Any) -> None:
        if self._opening.is_done:
            self.opened += 1
            self._open()
        self._opening.on_packet(packet, self._now_ns)
        self._opening.on_time(self._now_ns)
        try:
            self._measured.take(self._dialect.read(packet, self._now_ns), self._now_ns)
        except REFUSALS:
            self.refused += 1
        else:
            self.read += 1
        self._check()

    def _send(self, data: bytes) -> None:
        self.sent += len(data)
        assert not self.device.moves(data), f"the opening sends {data.hex()}, which moves the base"

    # --- what was measured ---------------------------------------------------------------------------

    def _check(self) -> None:
        limits = self.device.limits
        for name, reading in self._measured.readings(self._now_ns).items():
            low, high = limits.get(name, (0.0, 1.0))  # truth values need no row
            for value in _values(reading.value):
                assert low <= value <= high or value == math.inf, f"{name} is {value}"
        base, before = self._measured.base, self._base
        if base is None or base is before:
            return
        self._base = base
        most, turn = self.device.max_speed, self.device.max_turn
        finite = (base.x, base.y, base.heading, base.speed, base.turn_rate, base.wheel_speed)
        assert all(map(math.isfinite, finite)), base
        assert max(abs(base.speed), base.wheel_speed) <= most, base
        assert abs(base.turn_rate) <= turn, base
        if before is not None:
            time_s = (base.t_ns - before.t_ns) / 1e9 + SLACK_S
            # the registers of both axes may each have the greatest step
            assert math.dist((base.x, base.y), (before.x, before.y)) <= math.sqrt(2.0) * most * time_s, base


def _values(value: ScalarValue | tuple[ScalarValue, ...]) -> Iterator[float]:
    for one in value if isinstance(value, tuple) else (value,):
        assert not isinstance(one, str)
        yield float(one)
