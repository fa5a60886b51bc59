"""`wander` on three interfaces: RoME's 24 sonars, eight in another order, and the arc of a laser scanner.

Each description has the names that `wander` reads; what belongs to the robot stands there.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Frame
from colony.ir.program import Program, Sensor
from colony.ir.types import Array
from colony.nav.maps.building import load_building
from colony.nav.maps.walls import lights_of, walls_of
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import Proved
from colony.verify.testing.examples import failures_as_diagnostics, run_examples
from tests.paths import MAPS, ROOT

Floats = NDArray[np.float64]

WANDER = ROOT / "behaviors" / "wander.colony"
INTERFACES = sorted((Path(__file__).parent / "interfaces").glob("*.colony"))
ROBOTS = {"rome": "rome", **{path.stem: str(path) for path in INTERFACES}}

RADIUS_MM = 400.0

each_robot = pytest.mark.parametrize("robot", ROBOTS)


def wander(robot: str) -> Program:
    return load_file(WANDER, robot=ROBOTS[robot])


def test_the_interfaces_differ() -> None:
    found = [ranges_of(wander(robot)).type for robot in ROBOTS]
    sizes = [(t.size, t.bearings and t.bearings.angles[:2]) for t in found if isinstance(t, Array)]
    assert sizes == [(24, (-180.0, -165.0)), (541, (-135.0, -134.5)), (8, (0.0, -45.0))]


@each_robot
def test_its_examples_hold(robot: str) -> None:
    assert failures_as_diagnostics(run_examples(wander(robot))) == ()


@each_robot
def test_its_contracts_are_proved(robot: str) -> None:
    program = wander(robot)
    results = prove_contracts(program)
    assert len(results) == len(program.contracts) >= 7
    assert all(isinstance(result, Proved) for result in results)


@each_robot
def test_it_drives_a_minute_without_touching_a_wall(robot: str) -> None:
    track = driven(wander(robot), seconds=60.0)
    assert track.nearest_mm > RADIUS_MM
    assert track.distance_mm > 20_000.0


# --- one loop: rays, one frame of the program, one step of the base ----------------------------------------


class Track:
    """What came of a run. Mutable."""

    def __init__(self) -> None:
        self.distance_mm = 0.0
        self.nearest_mm = math.inf


def ranges_of(program: Program) -> Sensor:
    """The sensor that `ranges` names: the only ring or arc of distances that `wander` reads."""
    return next(s for s in program.robot.sensors if isinstance(s.type, Array) and s.low is not None)


def driven(program: Program, seconds: float) -> Track:
    """Drive in the building `loop`, from below its first ceiling light."""
    building = load_building(MAPS / "loop.stickrep").maps[0]
    walls = np.array(walls_of(building).segments)
    executor = ProgramExecutor(lower(program, compile_program(program).clients))
    ranges = ranges_of(program)
    (x, y), heading = lights_of(building)[0], 90.0
    track, frame_s = Track(), program.robot.frame_ns / 1e9
    for k in range(round(seconds / frame_s)):
        readings = {
            ranges.name: tuple(rays(walls, x, y, heading, ranges)),
            "front_bumper": False,
            "rear_bumper": False,
        }
        decision = executor.step(Frame(k * program.robot.frame_ns, readings)).decisions[0]
        assert decision.values is not None
        fields = zip(program.robot.actuators[0].fields, decision.values, strict=True)
        sent = {field.name: field.factor * value for field, value in fields}
        heading += sent["turn"] * frame_s
        step = sent["velocity"] * frame_s
        x, y = x - step * math.sin(math.radians(heading)), y + step * math.cos(math.radians(heading))
        track.distance_mm += abs(step)
        track.nearest_mm = min(track.nearest_mm, distance(walls, x, y))
    return track


def rays(walls: Floats, x: float, y: float, heading: float, sensor: Sensor) -> Floats:
    """The ranges along the sensor's bearings, in its unit, from the middle of the robot."""
    assert isinstance(sensor.type, Array)
    assert sensor.high is not None
    angles = np.radians(heading + np.array(sensor.type.bearings.angles))
    ray_x, ray_y = -np.sin(angles)[:, None], np.cos(angles)[:, None]
    from_x, from_y = walls[:, 0] - x, walls[:, 1] - y
    along_x, along_y = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    across = ray_x * along_y - ray_y * along_x
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (from_x * along_y - from_y * along_x) / across
        place = (from_x * ray_y - from_y * ray_x) / across
    hits = (depth > 0.0) & (place >= 0.0) & (place <= 1.0)
    nearest: Floats = np.where(hits, depth, sensor.high).min(axis=1)
    return np.maximum(nearest - RADIUS_MM, 0.0) / sensor.factor


def distance(walls: Floats, x: float, y: float) -> float:
    """From a point to the nearest wall."""
    start, along = walls[:, :2] - (x, y), walls[:, 2:4] - walls[:, :2]
    place = np.clip(-(start * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(start + place[:, None] * along).T).min())
