"""A server of a simulated robot, whose hardware is the plant: `python -m colony.sim.plant.servers SPEC`.

The plant itself is `colony.sim.plant.child`.
"""

from __future__ import annotations

from contextlib import ExitStack, closing
from pathlib import Path

from colony.runtime.assembly.processes.child import main
from colony.runtime.assembly.processes.spec import Device
from colony.runtime.servers.drivers import BaseLimits
from colony.sim.plant.drivers import RemoteBase, RemoteCamera, RemoteDevice, RemoteProximity


class PlantDevices:
    """Drivers of the devices in the plant."""

    def base(
        self, device: Device, robot: str, limits: BaseLimits, origin_ns: int, resources: ExitStack
    ) -> RemoteBase:
        """Open the base of a robot."""
        return resources.enter_context(
            closing(RemoteBase(Path(device.plant), robot, limits=limits, origin_ns=origin_ns))
        )

    def proximity(
        self, device: Device, robot: str, count: int, origin_ns: int, resources: ExitStack
    ) -> RemoteProximity:
        """Open the proximity sensors of a robot."""
        return resources.enter_context(
            closing(RemoteProximity(Path(device.plant), robot, count=count, origin_ns=origin_ns))
        )

    def camera(
        self, device: Device, robot: str, camera: str, origin_ns: int, resources: ExitStack
    ) -> RemoteCamera:
        """Open a camera of a robot."""
        return resources.enter_context(
            closing(RemoteCamera(Path(device.plant), robot, camera, origin_ns=origin_ns))
        )

    def device(self, device: Device, robot: str, server: str, resources: ExitStack) -> RemoteDevice:
        """Open the device of a server of a robot."""
        return resources.enter_context(closing(RemoteDevice(Path(device.plant), robot, server)))


if __name__ == "__main__":
    main(PlantDevices())
