"""The run behind `colony run`: program, building, simulated robot, runtime and picture wired together."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from colony.cli.outputs import cannot_write, check_output, open_alone, write_whole
from colony.cli.reporting import say
from colony.cli.run_options import BadOption, duration_ns, variables
from colony.cli.run_progress import PATIENCE_S, Progress
from colony.compile.pipeline import compile_program
from colony.ir.program import Program
from colony.nav.stickrep import Map
from colony.nav.stickrep_reader import load_map
from colony.nav.walls import walls_of
from colony.runtime.observer import FrameLog
from colony.runtime.recording import Recording
from colony.runtime.session import Session
from colony.runtime.summary import RunSummary, Tally, Travel
from colony.runtime.team import places_of
from colony.runtime.virtual import VirtualClock
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.world import World


class Misuse(Exception):
    """A map that was named cannot be used; the message is one line that begins with the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The command line of `colony run`, as given."""

    file: str
    map_path: str
    seed: int
    duration: str
    realtime: bool
    record: str | None
    picture: str | None
    settings: tuple[str, ...]


def run(program: Program, options: Options) -> RunSummary:
    """Run a program in a building to the end, or until it is interrupted.

    Raises:
        BadOption: an option makes no sense.
        Misuse: the robot has no room in the building.
        Failure: the map is bad (its codes begin with M), or the program asks for what the robot lacks.
        click.exceptions.Exit: a file cannot be written, which has been said.
    """
    length_ns = duration_ns(options.duration)
    held = variables(program, options.settings)
    _check_outputs(options)
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
    )
    if options.record is not None:
        session.add(_recording(program, options.record))
    session.add(Progress(length_ns))
    interrupted = _run(session, length_ns, options)
    summary = tally.summary(
        seed=options.seed,
        duration_s=clock() / 1e9,
        interrupted=interrupted,
        travel=Travel(bumps=plant.world.bumps(0), distance_mm=plant.world.distance(0)),
    )
    if options.picture is not None:
        _draw(building, way, program.robot.name, options.picture)
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


def _recording(program: Program, path: str) -> Recording:
    try:
        return Recording(program, open_alone(path))
    except BlockingIOError:
        cannot_write(path, "another run is recording into it")
    except OSError as problem:
        cannot_write(path, problem.strerror or str(problem))


# --- interruption and time -----------------------------------------------------------------------


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """While it lasts, the first Ctrl-C (or SIGTERM) is noted, for the run to end between two moments; the
    next one breaks in at once. Gives the function that tells whether there was one."""
    noted: list[int] = []
    reminder = threading.Timer(PATIENCE_S, say, ("stopping after this frame; Ctrl-C again stops at once",))
    reminder.daemon = True
    if threading.current_thread() is not threading.main_thread():
        yield lambda: bool(noted)
        return

    def note(number: int, _: object) -> None:
        if noted:
            raise KeyboardInterrupt
        noted.append(number)
        reminder.start()

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(noted)
    finally:
        reminder.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


def wall_clock() -> Callable[[int], None]:
    """A pace: sleeps until the moment has come by the wall clock."""
    start = time.monotonic_ns()

    def pace(t_ns: int) -> None:
        ahead = start + t_ns - time.monotonic_ns()
        if ahead > 0:
            time.sleep(ahead / 1e9)

    return pace


# --- the picture ---------------------------------------------------------------------------------


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


def _check_outputs(options: Options) -> None:
    """Refuse, before a long run, what could not be written after it, or what would overwrite its input."""
    record, picture = options.record, options.picture
    if picture is not None:
        from colony.view.map_picture import picture_format

        try:
            picture_format(picture)
        except ValueError as problem:
            raise BadOption(f"--picture: {problem}") from None
        if record is not None and os.path.realpath(record) == os.path.realpath(picture):
            raise BadOption(f"--record and --picture: found `{picture}` for both; expected two files")
    for path in (record, picture):
        if path is not None:
            check_output(path, [options.file, options.map_path])


def _draw(building: Map, way: Way, robot: str, path: str) -> None:
    from colony.view.map_picture import draw_map, encode_picture, picture_format

    places = np.array(way.places, dtype=np.float64).reshape(-1, 2)
    picture = draw_map(building, [places], names=[robot])
    write_whole(Path(path), encode_picture(picture, picture_format(path)))
