"""The devices of simulated robots, one file a kind of device: pure, and without a clock."""

from colony.sim.devices.device import SimulatedDevice
from colony.sim.devices.robot import devices_of

__all__ = ["SimulatedDevice", "devices_of"]
