"""A plant in a process of its own: `python -m tests.sim.plant.child SOCKET MAP ROBOTS [LOGICAL_NS]`.

ROBOTS is a JSON object of poses by name. It says "ready" and serves until its input ends.
"""

from __future__ import annotations

import json
import sys
import threading
from dataclasses import replace
from pathlib import Path

from colony.nav.maps.stickrep.reader import load_map
from colony.sim.plant.process import PlantOptions, serve_plant
from tests.sim.robots import FRONT_CAMERA, IDEAL


def main(path: str, building: str, robots: str, logical_ns: str | None = None) -> None:
    options = PlantOptions(
        path=Path(path),
        building=load_map(building),
        robots={name: tuple(pose) for name, pose in json.loads(robots).items()},
        cameras={"ahead": FRONT_CAMERA, "left": replace(FRONT_CAMERA, yaw_deg=90.0)},
        config=IDEAL,
        logical_ns=None if logical_ns is None else int(logical_ns),
    )
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    serve_plant(options, stop=ended.is_set, ready=lambda: print("ready", flush=True))


if __name__ == "__main__":
    main(*sys.argv[1:])
