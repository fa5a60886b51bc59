"""The run behind `colony run`: program, building, simulated robot, runtime and picture wired together."""

from __future__ import annotations

import time
from collections.abc import Callable

from colony.cli.interruption import interruptible
from colony.cli.outputs import cannot_write
from colony.cli.recordings import is_mcap, recording_into
from colony.cli.run_options import Misuse, Options, duration_ns, variables
from colony.cli.run_outputs import check_outputs, draw_way
from colony.cli.run_progress import Progress
from colony.compile.pipeline import compile_program
from colony.ir.program import Program
from colony.nav.stickrep import Map
from colony.nav.stickrep_reader import load_map
from colony.nav.walls import walls_of
from colony.runtime.observer import FrameLog
from colony.runtime.session import Session
from colony.runtime.summary import RunSummary, Tally, Travel
from colony.runtime.team import places_of
from colony.runtime.virtual import VirtualClock
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.world import World


def run(program: Program, options: Options) -> RunSummary:
    """Run a program in a building to the end, or until it is interrupted.

    Raises:
        BadOption: an option makes no sense.
        Misuse: the robot has no room in the building.
        Failure: the map is bad (its codes begin with M), or the program asks for what the robot lacks.
        click.exceptions.Exit: a file cannot be written, which has been said.
    """
    assert options.map_path is not None
    assert options.duration is not None
    length_ns = duration_ns(options.duration)
    held = variables(program, options.settings)
    check_outputs(options.record, options.picture, [options.file, options.map_path])
    building = load_map(options.map_path)
    clients = compile_program(program).clients
    clock = VirtualClock()
    plant = Plant(_world(building, options), clock)
    tally, way = Tally(program, places_of(program, clients)), Way(plant.world)
    session = Session(
        program,
        clients,
        simulated_drivers(plant),
        clock=clock,
        seed=options.seed,
        variables=held,
        sinks=(tally, way),
        requests=is_mcap(options.record),
    )
    if options.record is not None:
        session.add(recording_into(options.record, options.file, program, clients, seed=options.seed))
    session.add(Progress(length_ns))
    interrupted = _run(session, length_ns, options)
    summary = tally.summary(
        seed=options.seed,
        duration_s=clock() / 1e9,
        interrupted=interrupted,
        travel=Travel(bumps=plant.world.bumps(0), distance_mm=plant.world.distance(0)),
    )
    if options.picture is not None:
        draw_way(building, way.places, program.robot.name, options.picture)
    return summary


def _run(session: Session, length_ns: int, options: Options) -> bool:
    """Whether the run was interrupted."""
    with interruptible() as interrupted:
        try:
            return not session.run(
                length_ns, stop=interrupted, pace=wall_clock() if options.realtime else None
            )
        except KeyboardInterrupt:
            return True
        except OSError as problem:
            if options.record is None or problem.filename not in (None, options.record):
                raise
            cannot_write(options.record, problem.strerror or str(problem))


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


class Way:
    """The true way of the robot, a place a frame. A sink; mutable: the places so far."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.places: list[tuple[float, float]] = []

    def take(self, log: FrameLog) -> None:
        self._here()

    def close(self) -> None:
        self._here()

    def _here(self) -> None:
        pose = self._world.true_pose(0)
        self.places.append((pose.x_mm, pose.y_mm))
