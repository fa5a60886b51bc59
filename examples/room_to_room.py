"""Leads a robot from room to room, beside its processes: planner, clerk, light tracker and pose estimator.

    colony run behaviors/navigator.colony --map maps/msu_engineering_3.stickrep --processes \\
        --camera CServerUp=up --duration 5min &
    python examples/room_to_room.py rome maps/msu_engineering_3.stickrep 350R 376L

The robot has to stand before the first room, and is told so. The four are scripts
(colony/runtime/kit/script.py), each in a thread of this process with connections of its own; they could be
processes as well, on any machine. `colony drive --from 350R --to 376L` does the same for a robot that
`colony serve` serves, and starts the Navigator, too.
"""

from __future__ import annotations

import argparse
import sys

from colony.nav.maps.building import load_building
from colony.nav.plan.route import NoPlanError, plan
from colony.runs.live_mission import LiveMission
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.text.diagnostics import DiagnosticError


def main() -> int:
    """0 where the robot arrived, 1 where it did not, 2 where it cannot be sent there, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(description="Lead a robot from one room to another.")
    for name in ("robot", "map", "origin", "goal"):
        parser.add_argument(name)
    asked = parser.parse_args()
    try:
        building = load_building(asked.map)
        way = plan(building, asked.origin, asked.goal)
    except (DiagnosticError, NoPlanError) as problem:
        print(problem, file=sys.stderr)
        return 2
    try:
        with Session.open(asked.robot) as session, LiveMission(session, building, way) as mission:
            print(f"{way.origin} to {way.goal}: {way.modes}, {way.travel_mm / 1000:.1f} m", flush=True)
            mission.wait()
    except RobotConnectionError as problem:
        print(problem, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    if mission.problem:
        print(mission.problem, file=sys.stderr)
    print("arrived" if mission.arrived else "did not arrive", flush=True)
    return 0 if mission.arrived else 1


if __name__ == "__main__":
    sys.exit(main())
