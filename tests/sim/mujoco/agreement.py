"""How closely our simulator and MuJoCo agree on the same robot, `amr`, without its errors.

The tests hold the two to each other with it, and `python -m benchmarks physics` measures with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.body.devices import LidarSpec
from colony.body.model import Body
from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.nav.maps.stickrep.geometry import corners, in_free_space
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.sim.config import config_of, without_errors
from colony.sim.devices import devices_of
from colony.sim.mechanism import nothing_given
from colony.sim.mujoco.world import MujocoWorld
from colony.sim.physics import Physics
from colony.sim.world.world import World
from tests.paths import MAPS

FRAME_S = 0.05
LOOP = MAPS / "loop.stickrep"
CLEARANCE_MM = 450.0
WINDOW_MM = 10_000.0
"""Way over which headings are compared."""

Triple = tuple[float, float, float]


def exact_amr() -> Body:
    """The body of amr, whose lidar has neither noise nor dropouts."""
    body = shipped_body("amr")
    server = body.servers["Lidar"]
    assert isinstance(server.simulated, LidarSpec)
    lidar = replace(server.simulated, noise_mm=0.0, dropouts=0.0)
    return replace(body, servers={**body.servers, "Lidar": replace(server, simulated=lidar)})


def both(walls: NDArray[np.float64], pose: Triple = (0.0, 0.0, 0.0)) -> tuple[World, MujocoWorld]:
    """The same robot without errors in both, ours first."""
    body = exact_amr()
    config = without_errors(config_of(body))
    ours = World(walls=walls, poses=[pose], config=config)
    return ours, MujocoWorld(body=body, walls=walls, pose=pose, config=config)


# --- driving -------------------------------------------------------------------------------------


class Command(NamedTuple):
    """A command and how long it is given, in whole frames."""

    frames: int
    velocity_mm_s: float
    turn_deg_s: float


def random_commands(seed: int, seconds: float) -> list[Command]:
    """Commands of half a second to four, drawn from all that amr may be sent."""
    rng = np.random.default_rng(seed)
    commands: list[Command] = []
    left = round(seconds / FRAME_S)
    while left > 0:
        frames = min(int(rng.integers(10, 81)), left)
        left -= frames
        commands.append(Command(frames, rng.uniform(-300.0, 1000.0), rng.uniform(-90.0, 90.0)))
    return commands


class Track(NamedTuple):
    """Where a robot was after each frame: true poses (n, 3), headings unwrapped, and ways driven (n,)."""

    poses: NDArray[np.float64]
    ways_mm: NDArray[np.float64]


def driven(world: Physics, commands: Sequence[Command]) -> Track:
    """Drive a robot."""
    poses: list[Triple] = []
    ways: list[float] = []
    for command in commands:
        world.command(0, command.velocity_mm_s, command.turn_deg_s)
        for _ in range(command.frames):
            world.advance(FRAME_S)
            poses.append(world.true_pose(0))
            ways.append(world.distance(0))
    track = np.array(poses)
    track[:, 2] = np.degrees(np.unwrap(np.radians(track[:, 2])))
    return Track(track, np.array(ways))


class Difference(NamedTuple):
    """How far a drive in MuJoCo is from ours.

    Attributes:
        way_mm: the way in ours.
        way: the difference of the ways, as a part of ours.
        heading_deg: the most that the difference of the headings changes over ten meters of way.
        place_mm: the distance between the places at the end.
        odometry_mm: the distance between the true place and that by odometry in MuJoCo, at the end.
    """

    way_mm: float
    way: float
    heading_deg: float
    place_mm: float
    odometry_mm: float


def compared_drive(seed: int, seconds: float) -> Difference:
    """Give the same random commands to both in free space, and compare."""
    ours, theirs = both(np.empty((0, 4)))
    commands = random_commands(seed, seconds)
    here, there = driven(ours, commands), driven(theirs, commands)
    way_mm = float(here.ways_mm[-1])
    pose, odometry = theirs.true_pose(0), theirs.odometry(0)
    return Difference(
        way_mm,
        abs(float(there.ways_mm[-1]) / way_mm - 1.0),
        _most_over_window(here.ways_mm, there.poses[:, 2] - here.poses[:, 2]),
        float(np.hypot(*(there.poses[-1, :2] - here.poses[-1, :2]))),
        math.hypot(pose.x_mm - odometry.x_mm, pose.y_mm - odometry.y_mm),
    )


def _most_over_window(ways_mm: NDArray[np.float64], off_deg: NDArray[np.float64]) -> float:
    """The greatest change of a difference between two frames that are at most a window apart."""
    most = 0.0
    for i, way in enumerate(ways_mm):
        end = int(np.searchsorted(ways_mm, way + WINDOW_MM, side="right"))
        most = max(most, float(np.abs(off_deg[i:end] - off_deg[i]).max()))
    return most


# --- ranges --------------------------------------------------------------------------------------


def free_poses(seed: int, count: int) -> list[Triple]:
    """Poses in the corridors of the loop, at random, where amr fits."""
    floor = load_map(LOOP)
    walls, outlines = walls_of(floor), tuple(corners(ring) for ring in floor.rings)
    rng = np.random.default_rng(seed)
    low_x, low_y, high_x, high_y = walls.bounds
    found: list[Triple] = []
    while len(found) < count:
        x, y, heading = rng.uniform(low_x, high_x), rng.uniform(low_y, high_y), rng.uniform(0.0, 360.0)
        if in_free_space(outlines, x, y) and _clearance(walls.segments, x, y) > CLEARANCE_MM:
            found.append((float(x), float(y), float(heading)))
    return found


def _clearance(segments: NDArray[np.float64], x: float, y: float) -> float:
    start, along = segments[:, :2] - (x, y), segments[:, 2:] - segments[:, :2]
    part = np.clip(-(start * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(start + part[:, None] * along).T).min())


def scanned(world: Physics, body: Body) -> NDArray[np.float64]:
    """A scan of the robot's lidar now, in mm."""
    devices = devices_of(body, servers_of(body), world, 0, seed=1, given=nothing_given)
    sample = devices["Lidar"].sense(world.elapsed_ns)["scan"]
    return np.array(sample.value, dtype=np.float64)


def range_differences(seed: int, poses: int) -> NDArray[np.float64]:
    """How far the ranges of all beams differ at the same poses in the loop, in mm.

    Infinity for a beam that has an echo in one of the two alone.
    """
    walls, body = walls_of(load_map(LOOP)).segments, exact_amr()
    found = []
    for pose in free_poses(seed, poses):
        ours, theirs = (scanned(world, body) for world in both(walls, pose))
        same = np.isinf(ours) & np.isinf(theirs)
        found.append(np.where(same, 0.0, np.abs(np.where(same, 0.0, ours) - np.where(same, 0.0, theirs))))
    return np.concatenate(found)


# --- walls ---------------------------------------------------------------------------------------


SLANTED = np.array([[-1500.0, 2000.0 + 2598.0, 1500.0, 2000.0 - 2598.0]])
"""A wall ahead, which a robot that drives north meets at 30 degrees, with its right side."""


def slid_mm(world: Physics, seconds: float = 4.0) -> float:
    """How far a robot comes after it has touched a wall ahead, driving on."""
    world.command(0, 300.0, 0.0)
    while not world.bumps(0):
        world.advance(FRAME_S)
    begin = world.true_pose(0)
    for _ in range(round(seconds / FRAME_S)):
        world.advance(FRAME_S)
    end = world.true_pose(0)
    return math.hypot(end.x_mm - begin.x_mm, end.y_mm - begin.y_mm)


def stopped_within_mm(world: Physics) -> float:
    """How far a robot comes from full speed until it stands, after it is told to stop."""
    world.command(0, 1000.0, 0.0)
    for _ in range(60):
        world.advance(FRAME_S)
    way = world.distance(0)
    world.command(0, 0.0, 0.0)
    for _ in range(60):
        world.advance(FRAME_S)
    return world.distance(0) - way
