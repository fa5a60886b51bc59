r"""Two simulated robots in one building: in place of the hardware of both.

    python examples/two_robots/building.py --map examples/two_robots/narrow.stickrep \
        --robot ada=2500,1000,270 --robot ben=9000,3000,90

`colony serve Simulator` has a building for each robot; here several are in one, and see each other. The
servers of each robot find it where they look for their hardware: in the folder of their robot.
"""

from __future__ import annotations

import argparse
import os
import signal
from contextlib import ExitStack
from threading import Event

from colony.nav.maps.world_map import load_world
from colony.runtime.transport.live.robot_address import local
from colony.sim.plant.assembly import PlantOptions
from colony.sim.plant.child import SIMULATOR, plant_socket
from colony.sim.plant.process import serve_plant

Pose = tuple[float, float, float]


def robot(text: str) -> tuple[str, Pose]:
    """`NAME=X,Y,HEADING`, in mm and degrees counterclockwise from north.

    Raises:
        ValueError: the text is something else.
    """
    name, _, pose = text.partition("=")
    x, y, heading = (float(number) for number in pose.split(","))
    return name, (x, y, heading)


def main() -> None:
    """The entry of the program."""
    parser = argparse.ArgumentParser(description="Several simulated robots in one building.")
    parser.add_argument("--map", required=True, help="the building")
    parser.add_argument("--robot", action="append", required=True, type=robot, metavar="NAME=X,Y,HEADING")
    given = parser.parse_args()
    robots: dict[str, Pose] = dict(given.robot)
    ended = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with ExitStack() as holds:
        folders = [local(name, os.environ).directory for name in robots]
        for folder in folders:
            holds.enter_context(folder.claim(SIMULATOR))
        first, *others = (plant_socket(folder.path) for folder in folders)
        for other in others:
            other.unlink(missing_ok=True)
            other.symlink_to(first)
            holds.callback(other.unlink, missing_ok=True)
        world = load_world(given.map)
        serve_plant(
            PlantOptions(path=first, world=world, robots=robots),
            stop=ended.is_set,
            ready=lambda: print(f"{world.name}: {', '.join(robots)}", flush=True),
        )


if __name__ == "__main__":
    main()
