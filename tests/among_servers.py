"""A robot's program and scripts among the real servers in virtual time, over a simulated world."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.kit.script import Script
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.observe.observer import Sink
from colony.runtime.protocol.images import Image
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant, SimulatedCamera, simulated_drivers
from colony.sim.world.world import World

FRAME_NS = 50_000_000


def run_among_servers(
    text: str,
    world: World,
    scripts: Mapping[str, Script],
    *,
    run_ns: int,
    seed: int = 1,
    order: int = 1,
    cameras: Mapping[str, Callable[[int], Image]] | None = None,
    sinks: tuple[Sink, ...] = (),
) -> list[ScriptNode]:
    """Run a program of `FRAME_NS` and its scripts, and return the scripts' nodes, none of which failed.

    Args:
        order: draws the order of messages of one moment.
        cameras: by address, what takes an image of the present.
    """
    clock = VirtualClock()
    plant = Plant(world, lambda: clock() // FRAME_NS * FRAME_NS)
    eyes = {at: SimulatedCamera(plant, take) for at, take in (cameras or {}).items()}
    servers = ("DServer", "RServer", "PServer", *(cameras or {}))
    nodes = [ScriptNode(name, script, servers, delay_ns=1) for name, script in scripts.items()]
    session = VirtualSession(
        compile_program(load_text(text)).compiled,
        simulated_drivers(plant, cameras=eyes),
        clock=clock,
        seed=seed,
        sinks=sinks,
        order_seed=order,
        nodes=tuple(nodes),
    )
    session.run(run_ns)
    for node in nodes:
        if node.problem is not None:
            raise node.problem
    return nodes
