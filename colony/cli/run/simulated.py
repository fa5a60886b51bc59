"""The run behind `colony run`: program, building, simulated robot, runtime and picture wired together."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from colony.cli.interruption import interruptible
from colony.cli.recordings import RunRecording, is_mcap, recording_into
from colony.cli.run.options import Arrival, Misuse, Options, duration_ns, variables
from colony.cli.run.outputs import check_outputs, draw_paths
from colony.cli.run.progress import Progress
from colony.compile.pipeline import compile_program
from colony.experiment.expected import longest_ns
from colony.experiment.variants import OURS
from colony.ir.program import Program
from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.runtime.assembly.nodes import places_of
from colony.runtime.assembly.virtual import Session
from colony.runtime.observe.observer import FrameLog
from colony.runtime.observe.summary import RunSummary, Tally, Travel
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.world.world import World

if TYPE_CHECKING:
    from colony.cli.run.mission import Mission


def run(program: Program, options: Options) -> tuple[RunSummary, Arrival | None]:
    """Run a program in a building to the end, or until it is interrupted; and what came of the way, if any.

    Raises:
        BadOption: an option makes no sense.
        Misuse: the robot has no room in the building.
        Failure: the map is bad (its codes begin with M), or the program asks for what the robot lacks.
        click.exceptions.Exit: a file cannot be written, which has been said.
    """
    assert options.map_path is not None
    held = variables(program, options.settings)
    check_outputs(options.record, options.picture, [options.file, options.map_path])
    mission = None
    if options.goal is not None:
        from colony.cli.run.mission import Mission
        from colony.cli.run.way import way_of

        mission = Mission(way_of(options), options, program.robot.frame_ns)
    length_ns = _length_ns(options, mission)
    clients = compile_program(program).clients
    clock = VirtualClock()
    floors, plant, path = _building(options, mission, clock)
    tally = Tally(program, places_of(program, clients))
    session = Session(
        program,
        clients,
        simulated_drivers(plant),
        clock=clock,
        seed=options.seed,
        variables=held,
        sinks=(tally, path),
        requests=is_mcap(options.record),
        nodes=() if mission is None else mission.nodes(plant),
    )
    recording = None
    if options.record is not None:
        recording = recording_into(options.record, options.file, program, clients, seed=options.seed)
        session.add(recording)
    session.add(Progress(length_ns))
    interrupted = _run(session, length_ns, options, mission, recording)
    summary = tally.summary(
        seed=options.seed,
        duration_s=clock() / 1e9,
        interrupted=interrupted,
        travel=Travel(bumps=plant.world.bumps(0), distance_mm=plant.world.distance(0)),
    )
    if recording is not None:
        summary = replace(summary, broke_off=recording.broken_off)
    others: tuple[str, ...] | None = ()
    if options.picture is not None:
        others = draw_paths(floors, path.places, program.robot.name, options.picture)
        if others is None:
            summary = replace(summary, unwritten=(options.picture,))
    return summary, None if mission is None else mission.arrival(clock())._replace(pictures=others or ())


def _building(
    options: Options, mission: Mission | None, clock: VirtualClock
) -> tuple[tuple[Map, ...], Plant, Path]:
    """The floors, the robot on one of them, and its way."""
    if mission is not None:
        site = mission.site
        plant = Plant(site.world, clock, [site.elevators.advance])
        return tuple(site.maps.values()), plant, Path(plant.world, lambda: site.elevators.floor)
    assert options.map_path is not None
    floor = load_map(options.map_path)
    plant = Plant(_world(floor, options), clock)
    return (floor,), plant, Path(plant.world, lambda: floor.name)


def _length_ns(options: Options, mission: Mission | None) -> int:
    if options.duration is not None:
        return duration_ns(options.duration)
    assert mission is not None
    return longest_ns(mission.plan, OURS.mm_s)


def _run(
    session: Session,
    length_ns: int,
    options: Options,
    mission: Mission | None,
    recording: RunRecording | None,
) -> bool:
    """Whether the run was interrupted; it ends by itself when a mission is over, or its recording breaks
    off."""

    def over() -> bool:
        broken_off = recording is not None and recording.broken_off is not None
        return broken_off or (mission is not None and mission.is_over())

    with interruptible() as interrupted:
        try:
            pace = wall_clock() if options.realtime else None
            session.run(length_ns, stop=lambda: interrupted() or over(), pace=pace)
        except KeyboardInterrupt:
            return True
        if recording is not None:
            recording.expect_frames()
        return interrupted()


def _world(building: Map, options: Options) -> World:
    start = building.start
    pose = (start.x_mm, start.y_mm, start.heading_deg)
    try:
        return World(walls=walls_of(building).segments, poses=[pose], seed=options.seed)
    except ValueError as problem:
        raise Misuse(f"{options.map_path}: error: the robot cannot start there: {problem}") from None


# --- time ----------------------------------------------------------------------------------------


def wall_clock() -> Callable[[int], None]:
    """A pace: sleeps until the moment has come by the wall clock."""
    start = time.monotonic_ns()

    def pace(t_ns: int) -> None:
        ahead = start + t_ns - time.monotonic_ns()
        if ahead > 0:
            time.sleep(ahead / 1e9)

    return pace


# --- the way -------------------------------------------------------------------------------------


class Path:
    """The true way of the robot, a place a frame. A sink; mutable: the places so far, by floor."""

    def __init__(self, world: World, floor: Callable[[], str]) -> None:
        self._world, self._floor = world, floor
        self.places: dict[str, list[tuple[float, float]]] = {}

    def take(self, log: FrameLog) -> None:
        self._here()

    def close(self) -> None:
        self._here()

    def _here(self) -> None:
        pose = self._world.true_pose(0)
        self.places.setdefault(self._floor(), []).append((pose.x_mm, pose.y_mm))
