"""A run of a program on a robot in a simulated building, in one process and in virtual time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from colony.execute.compiled import Compiled
from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.robots.driven_path import DrivenPath
from colony.robots.expected import time_limit_ns
from colony.robots.recording import RunRecording, is_mcap, recording_into
from colony.robots.request import MisuseError, RunReport, RunRequest, UserInterface
from colony.robots.variants import OURS
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.observe.observer import FrameLog
from colony.runtime.observe.summary import Tally, Travel
from colony.runtime.protocol.bindings import bind
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.world.world import World

if TYPE_CHECKING:
    from colony.robots.mission import Mission


def run_in_building(compiled: Compiled, request: RunRequest, ui: UserInterface) -> RunReport:
    """Run a program to the end, or until it is interrupted; return the result of the run.

    Raises:
        MisuseError: the robot does not fit at its start, the route does not exist, or no recording can be
            written.
        DiagnosticError: the map is invalid (codes beginning with M), or the program needs something that the
            robot lacks.
    """
    bind(compiled.robot)  # what does not fit is reported before the simulator is compiled, which takes long
    mission = None
    if request.goal is not None:
        from colony.robots.mission import Mission
        from colony.robots.route import planned_route

        mission = Mission(planned_route(request), request)
    clock = VirtualClock()
    floors, plant, path = _building(request, mission, clock)
    tally = Tally(compiled)
    session = VirtualSession(
        compiled,
        simulated_drivers(plant, cameras=None if mission is None else mission.cameras(plant)),
        clock=clock,
        seed=request.seed,
        variables=request.pinned_variables,
        sinks=(tally, path),
        requests=is_mcap(request.record),
        nodes=() if mission is None else mission.nodes,
    )
    recording = None
    if request.record is not None:
        recording = recording_into(request.record, compiled, seed=request.seed)
        session.add(recording)
    interrupted = _run(session, request, ui, mission, recording)
    summary = tally.summary(
        seed=request.seed,
        duration_s=clock() / 1e9,
        interrupted=interrupted,
        travel=Travel(bumps=plant.world.bumps(0), distance_mm=plant.world.distance(0)),
    )
    if recording is not None:
        summary = replace(summary, broke_off=recording.truncation)
    return RunReport(
        summary, None if mission is None else mission.mission_result(clock()), floors, path.points
    )


def _building(
    request: RunRequest, mission: Mission | None, clock: VirtualClock
) -> tuple[tuple[Map, ...], Plant, PathSink]:
    """Return the floors, the robot on one of them, and the sink of its true path."""
    if mission is not None:
        site = mission.site
        plant = Plant(site.world, clock, [site.elevators.advance])
        return tuple(site.maps.values()), plant, PathSink(plant.world, lambda: site.elevators.floor)
    assert request.map_path is not None
    floor = load_map(request.map_path)
    start = floor.start
    pose = (start.x_mm, start.y_mm, start.heading_deg)
    try:
        world = World(walls=walls_of(floor).segments, poses=[pose], seed=request.seed)
    except ValueError as problem:
        raise MisuseError(f"{request.map_path}: error: the robot cannot start there: {problem}") from None
    return (floor,), Plant(world, clock), PathSink(world, lambda: floor.name)


def _run(
    session: VirtualSession,
    request: RunRequest,
    ui: UserInterface,
    mission: Mission | None,
    recording: RunRecording | None,
) -> bool:
    """Run the session; return True if it was interrupted.

    It ends early when the mission is over, or the recording breaks off.
    """
    length_ns = request.length_ns
    if length_ns is None:
        assert mission is not None
        length_ns = time_limit_ns(mission.plan, OURS.expected_mm_s)
    session.add(ui.progress(length_ns))

    def is_over() -> bool:
        is_truncated = recording is not None and recording.truncation is not None
        return is_truncated or (mission is not None and mission.is_over())

    with ui.interruptible() as interrupted:
        try:
            pace = wall_clock() if request.realtime else None
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
    """A sink that collects the robot's true path, by floor. Mutable."""

    def __init__(self, world: World, floor: Callable[[], str]) -> None:
        self._world, self._floor = world, floor
        self._paths: dict[str, DrivenPath] = {}

    def take(self, log: FrameLog) -> None:
        """Add the robot's pose in this frame."""
        self._add_pose()

    def close(self) -> None:
        """Add the robot's last pose."""
        self._add_pose()

    @property
    def points(self) -> dict[str, list[tuple[float, float]]]:
        """The points on each floor, in mm, in chronological order."""
        return {floor: path.points for floor, path in self._paths.items()}

    def _add_pose(self) -> None:
        pose = self._world.true_pose(0)
        self._paths.setdefault(self._floor(), DrivenPath()).add(pose.x_mm, pose.y_mm)
