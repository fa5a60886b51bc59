"""Servers of a simulated robot, as processes: `python -m colony.sim.plant.servers SPEC`.

Their hardware is the plant, which is `colony.sim.plant.child`.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from colony.runtime.assembly.processes.child import main
from colony.runtime.assembly.processes.spec import Device
from colony.sim.plant.drivers import RemoteBase, RemoteCamera, RemoteProximity


class PlantDevices:
    """Drivers of what is in the plant."""

    def base(self, device: Device, robot: str, base_ns: int, holds: ExitStack) -> RemoteBase:
        made = RemoteBase(Path(device.plant), robot, base_ns=base_ns)
        holds.callback(made.close)
        return made

    def proximity(self, device: Device, robot: str, base_ns: int, holds: ExitStack) -> RemoteProximity:
        made = RemoteProximity(Path(device.plant), robot, base_ns=base_ns)
        holds.callback(made.close)
        return made

    def camera(self, device: Device, robot: str, camera: str, base_ns: int, holds: ExitStack) -> RemoteCamera:
        made = RemoteCamera(Path(device.plant), robot, camera, base_ns=base_ns)
        holds.callback(made.close)
        return made


if __name__ == "__main__":
    main(PlantDevices())
