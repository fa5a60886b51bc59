"""How the process of a server comes to the driver of its hardware, whatever that is made of."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Protocol

from colony.runtime.assembly.processes.spec import Device
from colony.runtime.servers.drivers import BaseDriver, CameraDriver, ProximityDriver


class Devices(Protocol):
    """Makes drivers, which give nanoseconds since `base_ns` of the machine's monotonic clock.

    What a driver holds is closed with `holds`.
    """

    def base(self, device: Device, robot: str, base_ns: int, holds: ExitStack) -> BaseDriver: ...

    def proximity(self, device: Device, robot: str, base_ns: int, holds: ExitStack) -> ProximityDriver: ...

    def camera(
        self, device: Device, robot: str, camera: str, base_ns: int, holds: ExitStack
    ) -> CameraDriver: ...
