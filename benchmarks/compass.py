"""What a compass reads while a robot drives north through the longest corridor (thesis Figure 6.2).

The heading is true all the way; what differs is what iron in the building does to the compass.

    python -m benchmarks.compass [SEED [PICTURE]]

prints the figures, and draws the curve where a file is named (PNG or SVG).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.arguments import picture, whole_number
from colony.nav.maps.stickrep.reader import load_map
from colony.sim.config import rome_config, without_errors
from colony.sim.hazards.hazards import Hazard, Hazards, draw
from colony.sim.hazards.premises import premises_of
from colony.sim.world.world import World

MSU = Path(__file__).resolve().parent.parent / "maps" / "msu_engineering_3.stickrep"
SPEED_MM_S, STEP_S = 500.0, 0.5


class Reading(NamedTuple):
    """How far the robot has come, in m, and what the compass read, in degrees from north, in [-180, 180)."""

    way_m: float
    heading_deg: float


def drive_north(seed: int) -> list[Reading]:
    """The readings along the middle of the longest corridor that leads north."""
    floor = load_map(MSU)
    northward = [track for track in premises_of(floor).tracks if track.heading_deg == 0.0]
    track = max(northward, key=lambda t: t.length_mm)
    start = track.point_at(1000.0)
    world = World(
        walls=draw(Hazards().only(Hazard.COMPASS), floor, seed),
        poses=[(*start, 0.0)],
        config=without_errors(rome_config()),
    )
    world.command(0, SPEED_MM_S, 0.0)
    readings = []
    while world.distance(0) < track.length_mm - 2500.0:
        readings.append(Reading(world.distance(0) / 1000.0, (world.compass(0) + 180.0) % 360.0 - 180.0))
        world.advance(STEP_S)
    return readings


def main(arguments: Sequence[str] | None = None) -> None:
    """Print how far the compass is off, and draw it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compass", description=__doc__)
    seed = whole_number("seed", 0)
    parser.add_argument(
        "seed", type=seed, nargs="?", default=1, metavar="SEED", help="of the iron (default: 1)"
    )
    parser.add_argument("picture", type=picture, nargs="?", metavar="PICTURE", help="a .png or .svg to draw")
    chosen = parser.parse_args(arguments)
    readings = drive_north(chosen.seed)
    off = np.array([reading.heading_deg for reading in readings])
    print(
        f"{readings[-1].way_m:.0f} m north, seed {chosen.seed}: {off.min():+.0f} to {off.max():+.0f} degrees,"
    )
    print(f"{np.abs(off).mean():.0f} in the mean, more than 10 on {(np.abs(off) > 10).mean():.0%} of the way")
    if chosen.picture is not None:
        _draw(readings, chosen.picture)


def _draw(readings: list[Reading], target: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    axes.plot([r.way_m for r in readings], [r.heading_deg for r in readings], color="#1769d6", linewidth=1.2)
    axes.set(xlabel="way (m)", ylabel="compass (degrees from north)", ylim=(-75.0, 75.0))
    figure.savefig(target)


if __name__ == "__main__":
    main()
