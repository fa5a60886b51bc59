"""Leads a robot from room to room, beside its processes: planner, clerk, light tracker and local mapper.

    colony run behaviors/navigator.colony --map maps/msu_engineering_3.stickrep --processes \\
        --camera CServerUp=up --duration 5min &
    python examples/room_to_room.py rome maps/msu_engineering_3.stickrep 350R 376L

The robot has to stand before the first room, and is told so. The four are scripts
(colony/runtime/kit/script.py), each in a thread of this process with connections of its own; they could be
processes as well, on any machine.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from typing import Any

from colony.nav.clerk import clerk
from colony.nav.local_mapper import local_mapper
from colony.nav.plan import Plan
from colony.nav.planner import planner
from colony.nav.route import NoPlan, plan
from colony.nav.stickrep_reader import load_map
from colony.nav.walls import walls_of
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefused, ConnectionProblem
from colony.runtime.kit.script import Script
from colony.runtime.kit.script_live import run_script
from colony.runtime.library import camera, robot
from colony.runtime.library.ask import Ask
from colony.vision.light_tracker import light_tracker

DEVICE_S = 10.0
"""For how long a device may be about to start."""


def main() -> int:
    """0 where the robot arrived, 1 where it did not, 2 where it cannot be sent there."""
    parser = argparse.ArgumentParser(description="Lead a robot from one room to another.")
    for name in ("robot", "map", "origin", "goal"):
        parser.add_argument(name)
    asked = parser.parse_args()
    floor = load_map(asked.map)
    try:
        way = plan(floor, asked.origin, asked.goal)
    except NoPlan as problem:
        print(problem, file=sys.stderr)
        return 2
    helpers = {
        "clerk": clerk(),
        "tracker": light_tracker(),
        "mapper": local_mapper(walls_of(floor)),
    }
    with Session.open(asked.robot) as session:
        place(session, way)
        return 0 if lead(session, planner(way), helpers) else 1


def place(session: Session, way: Plan) -> None:
    """Tell the base where it stands: at the beginning, facing along the way."""
    first = way.segments[0]
    with session.connect("RServer", name="room_to_room") as base:
        once_there(base, robot.position())
        base.do(robot.set_position(first.start.x_mm, first.start.y_mm, first.heading_deg))
    with session.connect("CServerUp", name="room_to_room") as eye:
        once_there(eye, camera.size())
    print(f"{way.origin} to {way.goal}: {way.modes}, {way.way_mm / 1000:.1f} m", flush=True)


def once_there(server: Connection, ask: Ask[Any]) -> None:
    """Ask until the device has given something: it may have been started just now."""
    end = time.monotonic() + DEVICE_S
    while True:
        try:
            server.do(ask)
        except CallRefused:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)
        else:
            return


def lead(session: Session, leader: Script, helpers: dict[str, Script]) -> bool:
    """Run the planner to its end, with the others beside it; whether it came to its end."""
    stop = threading.Event()

    def help_out(name: str, script: Script) -> None:
        try:
            run_script(session, script, name=name, stop=stop)
        except ConnectionProblem as problem:
            print(f"{name}: {problem}", file=sys.stderr)
        finally:
            stop.set()  # nobody gets anywhere without the others

    threads = [threading.Thread(target=help_out, args=one, name=one[0]) for one in helpers.items()]
    for thread in threads:
        thread.start()
    try:
        arrived = run_script(session, leader, name="planner", stop=stop)
    except ConnectionProblem as problem:
        print(f"planner: {problem}", file=sys.stderr)
        arrived = False
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    print("arrived" if arrived else "did not arrive", flush=True)
    return arrived


if __name__ == "__main__":
    sys.exit(main())
