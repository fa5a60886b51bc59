"""The company of a robot in a simulated world: people who walk around, and other robots with their behaviors.

Other robots run in the fast loop, each over drivers of its own in the same world. The plant runs their frames
while the world catches up with the clock (`sim/drivers.py`), so that a seed gives one run.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from colony.body.model import Body
from colony.compile.pipeline import compile_program
from colony.execute.needs import sensors_without_default
from colony.ir.frame import Frame, Outcome
from colony.nav.maps.free_space import FreeSpace, NoRoomError
from colony.nav.maps.world_map import WorldMap
from colony.runs.behavior import behavior_from
from colony.runs.scenario import Scenario, player
from colony.runs.spec import MisuseError, OtherRobot, RunSpec
from colony.runtime.assembly.loop import Loop
from colony.runtime.observe.summary import OtherSummary
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.config import RobotConfig, config_of
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.hazards.scenery import Scenery, bare_scenery
from colony.sim.world.movers import free_pose, with_movers
from colony.sim.world.world import World

Pose = tuple[float, float, float]


def populated_world(floor: WorldMap, body: Body, spec: RunSpec) -> World:
    """Return the world of a run: its robot, number 0, the other robots in their order, and its people.

    Raises:
        MisuseError: the simulator cannot simulate a robot, or something does not fit into the map.
    """
    config = _config(body, spec.file)
    configs = [config, *(_config(other.described.body, _option(other)) for other in spec.others)]
    try:
        start: Pose = floor.start(config.radius_mm, spec.world.start)
        places = _Places(floor, start, config, spec.world.seed)
        poses = [start, *map(places.pose, spec.others, configs[1:])]
        scenery = places.populated(
            bare_scenery(floor.walls, seed=spec.world.seed, outlines=floor.has_outlines), spec.world.movers
        )
        return World(
            walls=scenery,
            poses=poses,
            config=configs,
            seed=spec.world.seed,
            holes=floor.holes,
            docks=floor.docks,
        )
    except ValueError as problem:
        who = "the robot cannot"
        if spec.others:
            names = [f"{number} is {other.name}" for number, other in enumerate(spec.others, 1)]
            who = f"the robots ({', '.join(['robot 0 runs ' + spec.file, *names])}) cannot"
        raise MisuseError(f"{spec.world.map_path}: error: {who} start there: {problem}") from None


class _Places:
    """The places in a map that a seed gives. Mutable: remembers where robots are."""

    def __init__(self, floor: WorldMap, start: Pose, config: RobotConfig, seed: int) -> None:
        self._floor, self._start, self._seed = floor, start[:2], seed
        self._taken = [(start[:2], config.radius_mm)]

    @cached_property
    def _space(self) -> FreeSpace:
        return FreeSpace(self._floor)

    def pose(self, other: OtherRobot, config: RobotConfig) -> Pose:
        """Return the start of another robot: the one that it is given, or a free one."""
        radius = config.radius_mm
        if other.start is not None:
            try:
                pose: Pose = self._floor.start(radius, other.start)
            except ValueError as problem:
                raise MisuseError(f"{_option(other)}: error: it cannot start there: {problem}") from None
        else:
            number = len(self._taken)
            try:
                pose = free_pose(
                    self._space, self._start, radius, self._taken, number=number, seed=self._seed
                )
            except NoRoomError as problem:
                raise MisuseError(f"{_option(other)}: error: {problem}") from None
        self._taken.append((pose[:2], radius))
        return pose

    def populated(self, scenery: Scenery, count: int) -> Scenery:
        """Return a scenery with people who walk between free places."""
        try:
            return with_movers(scenery, lambda: self._space, self._start, count, seed=self._seed)
        except NoRoomError as problem:
            raise MisuseError(f"--movers: error: {problem}") from None


def _config(body: Body, where: str) -> RobotConfig:
    try:
        return config_of(body)
    except ValueError as problem:
        raise MisuseError(f"{where}: error: `{body.robot.name}` cannot be simulated: {problem}") from None


def _option(other: OtherRobot) -> str:
    return f"--also {other.name}"


class RunningRobot:
    """Another robot of a run, a companion of its plant. Mutable.

    Args:
        other: the robot, and its program.
        plant: the world and its clock, at the beginning of the run.
        number: the number of the robot in the world.
        seed: the seed of the run.
        report: takes each problem of its devices, the first time that it occurs.

    Raises:
        DiagnosticError: its program needs something that the robot lacks, or a module in Python cannot be
            built.
        MisuseError: the robot has no base.
    """

    def __init__(
        self, other: OtherRobot, plant: Plant, number: int, *, seed: int, report: Callable[[str], None]
    ) -> None:
        behavior = behavior_from(other.program)
        scenario = other.scenario or Scenario()
        drivers = simulated_drivers(
            plant,
            number,
            body=other.described.body,
            servers=other.described.servers,
            seed=seed,
            given=scenario.value_at,
        )
        read = sensors_without_default(compile_program(other.program).compiled.code).values()
        self._unread = {s.name for sensors in read for s in sensors}
        try:
            self._loop = Loop(
                behavior.robot,
                behavior.executor(),
                drivers,
                {"scenario": player(scenario.variables)} if scenario.variables else {},
                clock=VirtualClock(),
                advance=lambda: None,
                seed=seed * 1_000_003 + number,
                watch=self._note if self._unread else None,
                report=lambda problem: report(f"{other.name}: {problem}"),
            )
        except ValueError as problem:
            raise MisuseError(f"{_option(other)}: error: {problem}") from None
        self._other, self._world, self.number = other, plant.world, number

    @property
    def name(self) -> str:
        """The name of the robot."""
        return self._other.name

    @property
    def due_ns(self) -> int:
        """The time of its next frame."""
        return self._loop.now_ns

    def run_frame(self) -> None:
        """Run this frame."""
        self._loop.frame()

    def _note(self, frame: Frame, outcome: Outcome) -> None:
        """Note which sensors have a value in a frame."""
        self._unread -= frame.readings.keys()

    def summary(self) -> OtherSummary:
        """Return what became of it so far."""
        return OtherSummary(
            name=self.name,
            robot=self._other.described.body.robot.name,
            behavior=Path(self._other.file).stem,
            bumps=self._world.bumps(self.number),
            distance_mm=self._world.distance(self.number),
            unread=tuple(sorted(self._unread)),
        )


def join_others(plant: Plant, spec: RunSpec, report: Callable[[str], None]) -> tuple[RunningRobot, ...]:
    """Return the other robots of a run, which run with the plant from now on.

    Raises:
        DiagnosticError, MisuseError: see `RunningRobot`.
    """
    running = tuple(
        RunningRobot(other, plant, number, seed=spec.world.seed, report=report)
        for number, other in enumerate(spec.others, 1)
    )
    for robot in running:
        plant.join(robot)
    return running
