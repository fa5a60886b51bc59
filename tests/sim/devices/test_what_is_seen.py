"""Which sensor sees what: every cell of the table in docs/devices.md, held against the simulator.

A robot drives toward one thing in a world that is otherwise empty. A sensor sees it if it ever reads anything
but what it reads in the empty world.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from colony.sim.hazards.scenery import CorridorTrack, Person, bare_scenery
from tests.paths import ROOT
from tests.sim.devices.stage import Stage

PAGE = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")
_, _SECTION = PAGE.split("## What each sensor sees\n")
HEAD, _, *ROWS = (
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in re.findall(r"^\|.*\|$", _SECTION, re.M)[:10]
)
CELLS = [(row[0], thing, said) for row in ROWS for thing, said in zip(HEAD[1:], row[1:], strict=True)]

SERVERS = """
[server.PServer.simulated]
device   = "proximity"
count    = 8
bearing  = "0 deg"
ring     = "200 mm"
sonar    = { range = "5 m", half_beam = "12 deg", critical = "30 deg" }
infrared = { range = "1 m" }

[server.Lidar.simulated]
device  = "lidar"
pose    = ["80 mm", "0 mm", "0 deg"]
count   = 61
bearing = "-90 deg"
step    = "3 deg"
range   = "3 m"

[server.Edges.simulated]
device = "range_finder"
poses  = [["180 mm", "0 mm", "0 deg"]]
range  = "1.5 m"

[server.Skirt.simulated]
device  = "bumper"
sectors = ["-90 deg .. 90 deg"]

[server.Floor.simulated]
device = "cliff"
places = [["310 mm", "0 mm"]]

[server.Eye.simulated]
device = "dock_sensor"
pose   = ["200 mm", "0 mm", "0 deg"]
range  = "4 m"
view   = "90 deg"
"""
AWAY = 900.0
"""Distance of the thing from the robot's center at first, in mm."""

FAR_DOCK = (0.0, 3000.0, 0.0)
ACROSS = np.array([[-1000.0, AWAY, 1000.0, AWAY]])

Read = Callable[[Stage], Any]
SENSORS: dict[str, Read] = {
    "sonars of `proximity`": lambda stage: stage.world.sonar(0).tolist(),
    "infrared of `proximity`": lambda stage: stage.world.infrared(0).tolist(),
    "`lidar`": lambda stage: stage.read("Lidar", "scan"),
    "`range_finder`": lambda stage: stage.read("Edges", "range"),
    "bumpers of `base`": lambda stage: tuple(stage.world.bumper(0)),
    "`bumper`": lambda stage: stage.read("Skirt", "bumper"),
    "`cliff`": lambda stage: stage.read("Floor", "cliff"),
    "`dock_sensor`": lambda stage: stage.read("Eye", "dock_seen"),
}


def world_with(thing: str) -> dict[str, Any]:
    """The arguments of a stage on which this stands ahead of the robot, "" for nothing."""
    empty = bare_scenery(np.empty((0, 4)))
    track = CorridorTrack(x_mm=0.0, y_mm=AWAY, heading_deg=0.0, length_mm=10.0, half_width_mm=260.0)
    person = Person(track=track, along_mm=0.0, offset_mm=0.0, forward=True, speed_mm_s=0.0)
    hole = [(-200.0, AWAY - 200.0), (200.0, AWAY - 200.0), (200.0, AWAY + 200.0), (-200.0, AWAY + 200.0)]
    scenes: dict[str, dict[str, Any]] = {
        "": {},
        "wall": {"walls": bare_scenery(ACROSS)},
        "glass": {"walls": replace(bare_scenery(ACROSS), silent=np.array([True]))},
        "person": {"walls": replace(empty, people=(person,))},
        "robot": {"poses": [(0.0, 0.0, 0.0), (0.0, AWAY, 0.0)]},
        "hole": {"holes": [hole]},
        "dock": {"docks": [(0.0, AWAY, 0.0)]},
    }
    return {"walls": empty, **scenes[thing]}


@cache
def readings(thing: str, *, with_dock: bool = False) -> dict[str, tuple[str, ...]]:
    """What each sensor reads on a drive of 4 s toward a thing, as text."""
    scene = world_with(thing)
    docks = scene.pop("docks", []) + ([FAR_DOCK] if with_dock else [])
    stage = Stage(SERVERS, docks=docks, **scene)
    found: dict[str, list[str]] = {sensor: [] for sensor in SENSORS}
    stage.world.command(0, 250.0, 0.0)
    for _ in range(40):
        for sensor, read in SENSORS.items():
            found[sensor].append(repr(read(stage)))
        stage.world.advance(0.1)
    return {sensor: tuple(texts) for sensor, texts in found.items()}


def test_the_table_has_every_sensor_and_every_thing() -> None:
    assert [row[0] for row in ROWS] == list(SENSORS)
    assert HEAD == ["sensor", "wall", "glass", "person", "robot", "hole", "dock"]


def test_an_empty_world_reads_the_same_everywhere() -> None:
    assert all(len(set(texts)) == 1 for texts in readings("").values())
    assert set(readings("", with_dock=True)["`dock_sensor`"]) == {"True"}


@pytest.mark.parametrize(("sensor", "thing", "said"), CELLS)
def test_a_cell_is_what_the_simulator_does(sensor: str, thing: str, said: str) -> None:
    is_seen = readings(thing)[sensor] != readings("")[sensor]
    hides = readings(thing, with_dock=True)["`dock_sensor`"] != readings("", with_dock=True)["`dock_sensor`"]
    if sensor == "`dock_sensor`" and hides:
        assert said == "hides docks"
    else:
        assert said == ("yes" if is_seen else "no")
