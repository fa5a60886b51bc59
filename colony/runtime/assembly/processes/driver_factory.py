"""The factory of the drivers of simulated devices, independent of the simulator, and what drivers raise."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Protocol

from colony.runtime.assembly.processes.spec import Device
from colony.runtime.servers.drivers import (
    BaseDriver,
    BaseLimits,
    CameraDriver,
    DeviceDriver,
    ProximityDriver,
)


class DriverError(Exception):
    """A driver cannot be imported or made; the message has its name, the reason, and the place of it.

    With `is_final` another try would not help: the program of the driver is wrong, not its device.
    """

    def __init__(self, message: str, *, is_final: bool) -> None:
        super().__init__(message)
        self.is_final = is_final


class DriverFactory(Protocol):
    """A factory of drivers. Their times are nanoseconds since `origin_ns` on the machine's monotonic clock.

    Each driver is closed with `resources`.
    """

    def base(
        self, device: Device, robot: str, limits: BaseLimits, origin_ns: int, resources: ExitStack
    ) -> BaseDriver:
        """Return the driver of the base."""
        ...

    def proximity(
        self, device: Device, robot: str, count: int, origin_ns: int, resources: ExitStack
    ) -> ProximityDriver:
        """Return the driver of the proximity sensors."""
        ...

    def camera(
        self, device: Device, robot: str, camera: str, origin_ns: int, resources: ExitStack
    ) -> CameraDriver:
        """Return the driver of a camera."""
        ...

    def device(self, device: Device, robot: str, server: str, resources: ExitStack) -> DeviceDriver:
        """Return the driver of the device of a server."""
        ...
