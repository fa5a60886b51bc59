"""The factory of hardware drivers for server processes, independent of the hardware."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Protocol

from colony.runtime.assembly.processes.spec import Device
from colony.runtime.servers.drivers import BaseDriver, CameraDriver, ProximityDriver


class Devices(Protocol):
    """A factory of drivers. Their times are nanoseconds since `origin_ns` on the machine's monotonic clock.

    Each driver is closed with `resources`.
    """

    def base(self, device: Device, robot: str, origin_ns: int, resources: ExitStack) -> BaseDriver:
        """Return the driver of the base."""
        ...

    def proximity(self, device: Device, robot: str, origin_ns: int, resources: ExitStack) -> ProximityDriver:
        """Return the driver of the proximity sensors."""
        ...

    def camera(
        self, device: Device, robot: str, camera: str, origin_ns: int, resources: ExitStack
    ) -> CameraDriver:
        """Return the driver of a camera."""
        ...
