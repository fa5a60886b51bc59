"""A run of a program on a robot in a simulated building, in one process and in virtual time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, assert_never

from colony.body.model import Body, radius_mm
from colony.execute.compiled import Compiled
from colony.ir.servers import DSERVER
from colony.nav.maps.driven_path import DrivenPath, LongestStay, MapExit, PeoplePaths
from colony.nav.maps.stickrep.model import Pose
from colony.nav.maps.world_map import WorldMap, load_world, world_of
from colony.runs.company import join_others, populated_world
from colony.runs.described import DescribedRobot
from colony.runs.navigation import EXPECTED_MM_S, time_limit_ns
from colony.runs.recording import RunRecording, is_mcap, recording_into
from colony.runs.scenario import Scenario, player
from colony.runs.spec import MisuseError, RunReport, RunSpec, UserInterface, expect_simulable
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.observe.stillness import Stillness
from colony.runtime.observe.summary import Tally, Travel
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.mechanism import nothing_given
from colony.sim.physics import Physics

if TYPE_CHECKING:
    from colony.runs.mission import Mission


def run_in_building(
    compiled: Compiled, described: DescribedRobot, spec: RunSpec, ui: UserInterface
) -> RunReport:
    """Run a program on its robot to the end, or until it is interrupted; return the result of the run.

    Raises:
        MisuseError: the simulator cannot simulate the robot, it does not fit at its start, the route does not
            exist or is not for this robot, or no recording can be written.
        DiagnosticError: the map is invalid (codes beginning with M), or the program needs something that the
            robot lacks.
    """
    expect_simulable(spec.physics, described.body, spec.file)
    bind(compiled.robot, described.servers)  # before the simulator is compiled, which takes long
    mission = None
    if spec.goal is not None:
        from colony.runs.mission import Mission
        from colony.runs.navigation import expect_rome, planned_route

        expect_rome(described.body)
        mission = Mission(planned_route(spec), spec)
    clock = VirtualClock()
    floors, plant, path = _building(spec, described.body, mission, clock)
    others = join_others(plant, spec, ui.report)
    other_paths = {other.name: PathSink(plant.world, path.floor, floors[0], other.number) for other in others}
    for remark in floors[0].remarks(radius_mm(described.body), plant.world.true_pose(0)):
        ui.report(remark)
    tally, stillness = Tally(compiled), Stillness(compiled, ui.stands)
    session = VirtualSession(
        compiled,
        simulated_drivers(
            plant,
            body=described.body,
            servers=described.servers,
            seed=spec.world.seed,
            given=nothing_given if spec.scenario is None else spec.scenario.value_at,
            cameras=None if mission is None else mission.cameras(plant),
        ),
        clock=clock,
        seed=spec.world.seed,
        variables=spec.pinned_variables,
        sinks=(tally, stillness, path, *other_paths.values()),
        requests=is_mcap(spec.record),
        nodes=(*_players(spec.scenario), *(() if mission is None else mission.nodes)),
        report=ui.report,
    )
    for sink in ui.sinks:
        session.add(sink)
    recording = None
    if spec.record is not None:
        recording = recording_into(spec.record, compiled, seed=spec.world.seed, robot=spec.robot)
        session.add(recording)
    interrupted = _run(session, spec, ui, mission, recording)
    summary = tally.summary(
        seed=spec.world.seed,
        duration_s=clock() / 1e9,
        interrupted=interrupted,
        travel=Travel(
            bumps=plant.world.bumps(0), distance_mm=plant.world.distance(0), off_map=path.exit.off_map
        ),
    )
    summary = replace(
        summary,
        unread=stillness.unread,
        others=tuple(
            replace(other.summary(), off_map=other_paths[other.name].exit.off_map) for other in others
        ),
    )
    if recording is not None:
        summary = replace(summary, broke_off=recording.truncation)
    return RunReport(
        summary,
        None if mission is None else mission.mission_result(clock()),
        floors,
        path.points,
        {name: sink.points[path.floor()] for name, sink in other_paths.items()},
        path.people.points,
        tuple(path.contacts),
        path.stay.longest_s,
        contact_s=tuple(path.contact_s),
    )


def _building(
    spec: RunSpec, body: Body, mission: Mission | None, clock: VirtualClock
) -> tuple[tuple[WorldMap, ...], Plant, PathSink]:
    """Return the floors, the robot on one of them, and the sink of its true path."""
    if mission is not None:
        site = mission.site
        plant = Plant(site.world, clock, [site.elevators.advance])
        floors = tuple(map(world_of, site.maps.values()))
        return floors, plant, PathSink(plant.world, lambda: site.elevators.floor, floors[0])
    assert spec.world.map_path is not None
    floor = load_world(spec.world.map_path)
    world = _physics(spec, body, floor)
    return (floor,), Plant(world, clock), PathSink(world, lambda: floor.name, floor)


def _physics(spec: RunSpec, body: Body, floor: WorldMap) -> Physics:
    """Return the robot at its start on a floor, in the physics that moves it."""
    match spec.physics:
        case "kinematic":
            return populated_world(floor, body, spec)
        case "mujoco":
            return _mujoco_world(spec, body, floor)
        case _:
            assert_never(spec.physics)


def _mujoco_world(spec: RunSpec, body: Body, floor: WorldMap) -> Physics:
    from colony.sim.mujoco.world import MujocoWorld

    try:
        return MujocoWorld(
            body=body,
            walls=floor.walls,
            pose=floor.start(radius_mm(body), spec.world.start),
            seed=spec.world.seed,
            holes=floor.holes,
            docks=floor.docks,
        )
    except ValueError as problem:
        raise MisuseError(f"{spec.world.map_path}: error: the robot cannot start there: {problem}") from None


def _players(scenario: Scenario | None) -> Iterator[ScriptNode]:
    """Yield the script that sets DServer's variables as the scenario says, if it says anything of them."""
    if scenario is not None and scenario.variables:
        yield ScriptNode("scenario", player(scenario.variables), (DSERVER.name, CLOCK))


def _run(
    session: VirtualSession,
    spec: RunSpec,
    ui: UserInterface,
    mission: Mission | None,
    recording: RunRecording | None,
) -> bool:
    """Run the session; return True if it was interrupted.

    It ends early when the mission is over, or the recording breaks off.
    """
    length_ns = spec.length_ns
    if length_ns is None:
        assert mission is not None
        length_ns = time_limit_ns(mission.plan, EXPECTED_MM_S)
    session.add(ui.progress(length_ns))

    def is_over() -> bool:
        is_truncated = recording is not None and recording.truncation is not None
        return is_truncated or (mission is not None and mission.is_over())

    with ui.interruptible() as interrupted:
        try:
            pace = wall_clock() if spec.realtime else None
            session.run(length_ns, stop=lambda: interrupted() or is_over(), pace=pace)
        except KeyboardInterrupt:
            return True
        if recording is not None:
            recording.expect_frames()
        return interrupted()


# --- time ----------------------------------------------------------------------------------------


def wall_clock() -> Callable[[int], None]:
    """Return a function that sleeps until the wall clock has reached a time of the run."""
    start = time.monotonic_ns()

    def pace(t_ns: int) -> None:
        ahead_ns = start + t_ns - time.monotonic_ns()
        if ahead_ns > 0:
            time.sleep(ahead_ns / 1e9)

    return pace


# --- the path ------------------------------------------------------------------------------------


class PathSink:
    """A sink that collects a robot's true path, by floor, its contacts, and whether it left the map. Mutable.

    That of robot 0 collects the paths of the people, too.

    Args:
        world: the world.
        floor: function that returns the name of the current floor.
        first_floor: the floor where the run begins, the only one that can be a grid.
        robot: the number of the robot.
    """

    def __init__(
        self, world: Physics, floor: Callable[[], str], first_floor: WorldMap, robot: int = 0
    ) -> None:
        self._world, self.floor, self._robot = world, floor, robot
        self.exit = MapExit(first_floor)
        self.stay = LongestStay()
        self.contacts: list[tuple[float, float]] = []
        self.contact_s: list[float] = []
        self._bumps = 0
        self._paths: dict[str, DrivenPath] = {}
        self.people = PeoplePaths()

    def take(self, log: RunFrame) -> None:
        """Add the robot's pose in this frame."""
        pose = self._add_pose()
        t_s = log.frame.t_ns / 1e9
        self.exit.add(t_s, pose.x_mm, pose.y_mm)
        self.stay.add(t_s, pose.x_mm, pose.y_mm)
        bumps = self._world.bumps(self._robot)
        self.contacts += [(pose.x_mm, pose.y_mm)] * (bumps - self._bumps)
        self.contact_s += [t_s] * (bumps - self._bumps)
        self._bumps = bumps

    def close(self) -> None:
        """Add the robot's last pose."""
        self._add_pose()

    @property
    def points(self) -> dict[str, list[tuple[float, float]]]:
        """The points on each floor, in mm, in chronological order."""
        return {floor: path.points for floor, path in self._paths.items()}

    def _add_pose(self) -> Pose:
        pose = self._world.true_pose(self._robot)
        self._paths.setdefault(self.floor(), DrivenPath()).add(pose.x_mm, pose.y_mm)
        if self._robot == 0:
            self.people.add(self.floor(), self._world.situation().people.tolist())
        return pose
