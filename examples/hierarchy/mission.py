"""The mission layer: it goes through a list of places.

    python examples/hierarchy/mission.py --robot layered --place 3500,1500 --place 4500,2200

It gives the task layer one goal after the other, and waits until that one says that it is reached. Then it
ends.
"""

from __future__ import annotations

import argparse
from contextlib import suppress

from colony.runtime.kit.connection import Connection, connect
from colony.runtime.library import data

Place = tuple[float, float]


def run(layers: Connection, places: list[Place]) -> None:
    """Have the robot go to each place in turn."""
    layers.do(data.set("Arrived", 0))
    layers.keep(data.watch("Arrived"))
    for number, (x, y) in enumerate(places, start=1):
        print(f"to {x:g}, {y:g}", flush=True)
        layers.do(data.set("Goal", {"number": number, "x": x, "y": y}))
        for notice in layers.notices():
            present = data.change(notice).present
            if present is not None and present.read(int) == number:
                break
    layers.do(data.set("Mission", "complete"))
    print("mission complete", flush=True)


def place(text: str) -> Place:
    """Two numbers with a comma between them, in mm.

    Raises:
        ValueError: the text is something else.
    """
    x, y = text.split(",")
    return float(x), float(y)


def main() -> None:
    """The entry of the program."""
    parser = argparse.ArgumentParser(description="The mission layer.")
    parser.add_argument("--robot", required=True, help="the robot's name")
    parser.add_argument("--place", action="append", required=True, type=place, metavar="X,Y", help="in mm")
    given = parser.parse_args()
    with connect("DServer", robot=given.robot, name="mission layer") as layers:
        run(layers, given.place)


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()
