"""Servers of a robot whose devices answer at once, always the same: what is timed is the runtime alone.

python -m benchmarks.scripted_servers SPEC
"""

from __future__ import annotations

import time
from contextlib import ExitStack

from colony.runtime.assembly.processes.child import main
from colony.runtime.assembly.processes.spec import Device
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseLimits, BaseState, CameraDriver, DeviceDriver

RANGES = tuple(500.0 + 50.0 * i for i in range(24))


class ScriptedDevices:
    """A base and rings of sensors that nothing ever happens to."""

    register_bits: int | None = None
    limits = BaseLimits(velocity=600.0, turn=90.0, acceleration=800.0, turn_acceleration=240.0)

    count = 24

    def __init__(self) -> None:
        self._origin_ns = 0

    def base(
        self, device: Device, robot: str, limits: BaseLimits, origin_ns: int, holds: ExitStack
    ) -> ScriptedDevices:
        self._origin_ns = origin_ns
        return self

    def proximity(
        self, device: Device, robot: str, count: int, origin_ns: int, holds: ExitStack
    ) -> ScriptedDevices:
        self._origin_ns = origin_ns
        return self

    def camera(
        self, device: Device, robot: str, camera: str, origin_ns: int, holds: ExitStack
    ) -> CameraDriver:
        raise NotImplementedError("it has no camera")

    def device(self, device: Device, robot: str, server: str, holds: ExitStack) -> DeviceDriver:
        raise NotImplementedError("it has no other device")

    def drive(self, velocity: float, turn: float) -> None:
        pass

    def stop(self) -> None:
        pass

    def state(self) -> BaseState:
        return BaseState(
            t_ns=self._now(),
            x=0.0,
            y=0.0,
            heading=0.0,
            front_bumper=False,
            rear_bumper=False,
            speed=0.0,
            turn_rate=0.0,
            wheel_speed=0.0,
        )

    def sonar(self) -> Sample:
        return Sample(RANGES, self._now())

    def infrared(self) -> Sample:
        return Sample((False,) * 24, self._now())

    def _now(self) -> int:
        return time.monotonic_ns() - self._origin_ns


if __name__ == "__main__":
    main(ScriptedDevices())
