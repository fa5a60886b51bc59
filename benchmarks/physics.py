"""How closely our simulator and MuJoCo agree on `amr` (docs/physics.md), and how fast each of them is.

Sensors and odometry are exact. Both get the same commands for a minute, drawn for each of ten seeds, in free
space; their lidars are compared at the same poses in maps/loop.stickrep; both brake, and drive into a wall.
Then `wander` drives for an hour of simulated time on that map in each, with all errors of the robot.

    python -m benchmarks.physics PICTURE

draws the picture of the page (PNG or SVG) instead of measuring.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.arguments import picture
from colony.body.shipped import shipped_body
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from colony.nav.maps.building import Building
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.runs.building_run import run_in_building
from colony.runs.described import described_robot
from colony.runs.spec import PhysicsName, RunReport, RunSpec, UserInterface
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.kit.script import Script
from colony.sim.world_spec import WorldSpec
from tests.paths import MAPS, ROOT
from tests.sim.mujoco.agreement import (
    LOOP,
    SLANTED,
    both,
    compared_drive,
    driven,
    random_commands,
    range_differences,
    slid_mm,
    stopped_within_mm,
)

Row = dict[str, object]

SEEDS = range(1, 11)
MINUTE_S = 60.0
HOUR_S = 3600.0
POSES = 100
NEAR_MM = 20.0
TARGET_WAY_PERCENT = 2.0
TARGET_HEADING_DEG = 3.0
TARGET_RANGES_PERCENT = 95.0
PHYSICS: tuple[PhysicsName, ...] = ("kinematic", "mujoco")


class _Silent:
    """A sink that shows nothing."""

    def take(self, log: RunFrame) -> None:
        """Show nothing."""

    def close(self) -> None:
        """Hold nothing."""


@contextmanager
def _uninterrupted() -> Iterator[Callable[[], bool]]:
    yield lambda: False


def _nobody(building: Building) -> Script:
    raise AssertionError("no elevators on this way")


_INTERFACE = UserInterface(
    report=print, interruptible=_uninterrupted, progress=lambda length_ns: _Silent(), operator=_nobody
)


def wander(physics: PhysicsName, seconds: float, seed: int = 1) -> RunReport:
    """A run of `wander` on amr in the building with a loop."""
    compiled = compile_program(load_file(ROOT / "behaviors" / "wander.colony", robot="amr")).compiled
    spec = RunSpec(
        file="wander",
        world=WorldSpec(map_path=str(MAPS / "loop.stickrep"), seed=seed),
        length_ns=round(seconds * 1e9),
        physics=physics,
    )
    return run_in_building(compiled, described_robot(compiled.robot), spec, _INTERFACE)


def _row(name: str, value: float, unit: str, note: str, most: float | None = None) -> Row:
    is_met = most is None or value <= most
    return {"name": name, "value": value, "unit": unit, "target": most, "ok": is_met, "note": note}


def _drives() -> list[Row]:
    found = [compared_drive(seed, MINUTE_S) for seed in SEEDS]
    way_m = [difference.way_mm / 1e3 for difference in found]
    driven_note = f"the most of {len(found)} drives of a minute, {min(way_m):.0f} to {max(way_m):.0f} m"
    return [
        _row("way", 100.0 * max(d.way for d in found), "%", driven_note, TARGET_WAY_PERCENT),
        _row(
            "heading",
            max(d.heading_deg for d in found),
            "deg",
            "the most that its difference changes over 10 m, also while turning at 90 deg/s",
            TARGET_HEADING_DEG,
        ),
        _row("place", max(d.place_mm for d in found), "mm", "the most after a minute"),
        _row("odometry", max(d.odometry_mm for d in found), "mm", "the most in MuJoCo from the true place"),
    ]


def _ranges() -> list[Row]:
    differences = range_differences(1, POSES)
    far = 100.0 * float((differences > NEAR_MM).mean())
    note = f"of {len(differences):,}, at {POSES} poses; the greatest difference is {differences.max():.1g} mm"
    return [_row("ranges off by over 20 mm", far, "%", note, 100.0 - TARGET_RANGES_PERCENT)]


def _walls() -> list[Row]:
    brake, slide = (
        [measure(world) for world in both(walls)]
        for measure, walls in ((stopped_within_mm, np.empty((0, 4))), (slid_mm, SLANTED))
    )
    return [
        _row(f"braking, {name}", way, "mm", "from 1 m/s with 1 m/s²: 500 mm")
        for name, way in zip(PHYSICS, brake, strict=True)
    ] + [
        _row(f"sliding, {name}", way, "mm", "along a wall met at 30 degrees, in 4 s")
        for name, way in zip(PHYSICS, slide, strict=True)
    ]


def _wandering() -> list[Row]:
    rows = []
    for physics in PHYSICS:
        begun = time.process_time()
        summary = wander(physics, HOUR_S).summary
        took_s = time.process_time() - begun
        assert summary.distance_mm is not None
        assert summary.bumps is not None
        note = (
            f"{summary.distance_mm / 1e3:,.0f} m of `wander` in an hour, in {took_s:.0f} s of the processor"
        )
        rows.append(_row(f"contacts, {physics}", float(summary.bumps), "", note, 0.0))
    return rows


def run() -> list[Row]:
    """All figures; a target is the most that is allowed."""
    return [*_drives(), *_ranges(), *_walls(), *_wandering()]


# --- the picture ---------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.physics", description=__doc__)
    parser.add_argument("picture", type=picture, metavar="PICTURE", help="a .png or .svg to draw")
    draw(parser.parse_args(arguments).picture)


def draw(target: Path) -> None:
    """Draw a drive in both, how far they are apart over ten, and `wander` in both."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    mpl.rcParams.update({"svg.hashsalt": "physics", "axes.titlesize": "medium"})
    figure = Figure(figsize=(10.0, 3.4), layout="constrained")
    drive, apart, corridor = figure.subplots(1, 3, width_ratios=[1.0, 1.15, 1.4])
    for seed in SEEDS:
        commands = random_commands(seed, MINUTE_S)
        ours, theirs = (driven(world, commands) for world in both(np.empty((0, 4))))
        off_mm = np.hypot(*(theirs.poses[:, :2] - ours.poses[:, :2]).T)
        apart.plot(ours.ways_mm / 1e3, off_mm, color="#1769d6" if seed == 1 else "0.7", linewidth=1.0)
        if seed == 1:
            drive.plot(*ours.poses[:, :2].T / 1e3, color="#d95f02", linewidth=2.4, label="ours")
            drive.plot(*theirs.poses[:, :2].T / 1e3, color="#1769d6", linewidth=0.9, label="MuJoCo")
    drive.set(title="same commands, 1 min", xlabel="x (m)", ylabel="y (m)", aspect="equal")
    drive.legend(frameon=False, fontsize="small")
    apart.set(
        title="distance between the two, ten drives",
        xlabel="way (m)",
        ylabel="distance (mm)",
        ylim=(0.0, None),
    )
    for x0, y0, x1, y1 in walls_of(load_map(LOOP)).segments / 1e3:
        corridor.plot([x0, x1], [y0, y1], color="0.4", linewidth=0.8)
    for physics, color, width in zip(PHYSICS, ("#d95f02", "#1769d6"), (2.4, 0.9), strict=True):
        points = np.array(wander(physics, 120.0).paths["loop"]) / 1e3
        corridor.plot(*points.T, color=color, linewidth=width)
    corridor.set(title=f"wander on {shipped_body('amr').robot.name}, 2 min", aspect="equal")
    corridor.set_axis_off()
    figure.savefig(target, metadata={"Date": None} if target.suffix == ".svg" else None)


if __name__ == "__main__":
    main()
