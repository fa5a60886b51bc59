"""A plant in a process of its own: `python -m tests.sim.plant.child SOCKET MAP ROBOTS BODY`.

ROBOTS is a JSON object of poses by name, BODY the name of a robot that comes with colony; RoME has no errors
here. It says "ready" and serves until its input ends.
"""

from __future__ import annotations

import json
import sys
import threading
from dataclasses import replace
from pathlib import Path

from colony.body.shipped import shipped_body
from colony.nav.maps.world_map import load_world
from colony.sim.plant.assembly import PlantOptions
from colony.sim.plant.process import serve_plant
from tests.sim.robots import FRONT_CAMERA, IDEAL


def main(path: str, building: str, robots: str, body: str) -> None:
    options = PlantOptions(
        path=Path(path),
        world=load_world(building),
        robots={name: tuple(pose) for name, pose in json.loads(robots).items()},
        cameras={"ahead": FRONT_CAMERA, "left": replace(FRONT_CAMERA, yaw_deg=90.0)},
        body=shipped_body(body),
        config=IDEAL if body == "rome" else None,
    )
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    serve_plant(options, stop=ended.is_set, ready=lambda: print("ready", flush=True))


if __name__ == "__main__":
    main(*sys.argv[1:])
