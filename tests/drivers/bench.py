"""A dialect and an emulated robot on one line without loss, in counted time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic

from colony.drivers.dialect import Dialect, OpeningRun, Packet
from colony.drivers.emulator import STEP_S, Firmware
from colony.drivers.line import Measurements
from colony.runtime.servers.drivers import BaseState

STEP_NS = round(STEP_S * 1e9)
FRAME_STEPS = 10
"""Steps of a frame of 50 ms."""


class Bench(Generic[Packet]):
    """A line. Mutable: counts time, and keeps what was sent to the robot, and the last packet from it.

    Args:
        dialect: the dialect, which opens the line.
        robot: what runs in the robot.
        hears: whether a packet arrives; by default each does.

    Attributes:
        latency_s: seconds until what the robot sends arrives.
    """

    def __init__(
        self,
        dialect: Dialect[Packet],
        robot: Firmware,
        *,
        hears: Callable[[Packet], bool] = lambda packet: True,
    ) -> None:
        self._dialect, self._robot, self._hears = dialect, robot, hears
        self.now_ns, self.sent = 0, bytearray()
        self.latency_s = 0.0
        self._late: deque[tuple[int, bytes]] = deque()
        self.last: Packet | None = None
        self._decoder = dialect.decoder()
        self.measured = Measurements(
            rings=dialect.rings, bounds=dialect.bounds, max_speed=dialect.max_speed, max_turn=dialect.max_turn
        )
        self.begin()

    def begin(self) -> None:
        """Open the line, as after a pulled cable."""
        self._dialect.restart()
        self.opening = OpeningRun(self._dialect.opening(), self.send, self.now_ns)

    def send(self, data: bytes) -> None:
        """Send bytes to the robot."""
        self.sent += data
        self._robot.receive(data)

    def run(self, seconds: float, drive: tuple[float, float] | None = None) -> None:
        """Let time pass; with `drive`, each 50 ms a frame decides for it."""
        for i in range(round(seconds / STEP_S)):
            if drive and i % FRAME_STEPS == 0:
                self.send(self._dialect.drive(*drive))
            self.now_ns += STEP_NS
            self._robot.step()
            self._late.append((self.now_ns + round(self.latency_s * 1e9), b"".join(self._robot.sent())))
            for packet in self._decoder.feed(self._arrived()):
                if self._hears(packet):
                    self.last = packet
                    self.opening.on_packet(packet, self.now_ns)
                    self.measured.take(self._dialect.read(packet, self.now_ns), self.now_ns)
            self.opening.on_time(self.now_ns)

    def _arrived(self) -> bytes:
        data = b""
        while self._late and self._late[0][0] <= self.now_ns:
            data += self._late.popleft()[1]
        return data

    def open(self, seconds: float) -> None:
        """Let the opening end, which takes at most so long."""
        self.run(seconds)
        assert self.opening.is_done

    @property
    def base(self) -> BaseState:
        """The newest state of the base."""
        assert self.measured.base is not None
        return self.measured.base
