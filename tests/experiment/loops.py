"""The fast loop of a robot in a world, for tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from colony.ir.types import Value
from colony.runs.behavior import Behavior
from colony.runtime.assembly.loop import Loop, Watch
from colony.runtime.kit.script import Script
from colony.runtime.protocol.images import Shot
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant, SimulatedCamera, simulated_drivers
from colony.sim.world.world import World


def loop_of(
    behavior: Behavior,
    world: World,
    scripts: Mapping[str, Script],
    *,
    cameras: Mapping[str, Callable[[int], Shot]] | None = None,
    seed: int = 0,
    variables: Mapping[str, Value] | None = None,
    watch: Watch | None = None,
    moving: Sequence[Callable[[float], None]] = (),
) -> Loop:
    """Return the loop of robot 0 of a world; `cameras` are what takes an image of the present, by address."""
    clock = VirtualClock()
    plant = Plant(world, clock, moving)
    eyes = {address: SimulatedCamera(plant, take) for address, take in (cameras or {}).items()}
    return Loop(
        behavior.robot,
        behavior.executor(),
        simulated_drivers(plant, cameras=eyes),
        scripts,
        clock=clock,
        advance=plant.catch_up,
        seed=seed,
        variables=variables,
        watch=watch,
    )
