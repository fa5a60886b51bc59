"""A run of a program by processes: its clients, and servers that are started with them or run already."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

from colony.execute.compiled import Compiled
from colony.ir.program import Robot
from colony.os_errors import naming
from colony.robots.finding import running_robots, session_with
from colony.robots.recording import RunRecording, recording_into
from colony.robots.request import Arrival, Attendant, Driven, MisuseError, RunAbortedError, RunRequest
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.assembly.processes.children import Job
from colony.runtime.assembly.processes.jobs import client_jobs, expect_room, fresh_folder, keep_logs
from colony.runtime.assembly.processes.run import LedRun, RunFailedError
from colony.runtime.assembly.processes.standings import Standings
from colony.runtime.assembly.processes.window import Window
from colony.runtime.observe.summary import RunSummary, Tally, Travel
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.fields import DSERVER, SERVERS, ServerSpec
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.place import Local, Place
from colony.runtime.transport.live.run_directory import in_run_directory

if TYPE_CHECKING:  # not every run plans or leads a mission
    from colony.robots.live_mission import LiveMission
    from colony.robots.way import Way

PLANT_S = 120.0
"""Timeout in seconds for the simulator to start; without a cache it is compiled first."""


def run_here(compiled: Compiled, place: Local, request: RunRequest, attendant: Attendant) -> Driven:
    """Run a program on a simulated robot: start servers, clients and the plant, and end them with the run.

    Raises:
        MisuseError: the way does not exist, or no recording can be written.
        DiagnosticError: the map is invalid (codes beginning with M), or the program needs something that the
            robot lacks.
        LiveError: the robot's processes cannot be joined; for example, another run of it is in progress.
        RunAbortedError: the run could not begin, or broke off.
    """
    from colony.nav.maps.stickrep.reader import load_map
    from colony.robots.simulated import CompilingNotice, SimulatedRobot, TruthLog, jobs_of

    assert request.map_path is not None
    way = _way_here(request) if request.goal is not None else None
    run = _Run(compiled, place, request, attendant, way)
    looking = dict(request.cameras)
    if way is not None:
        from colony.robots.variants import CEILING_CAMERA

        looking = {CEILING_CAMERA: "up", **looking}
    building = load_map(request.map_path)
    truth = TruthLog(place)
    with run.led() as led:
        robot = SimulatedRobot(
            map_path=request.map_path,
            seed=request.seed,
            state=run.folder,
            cameras=looking,
            fsync=request.fsync,
            start=None if way is None else way.start,
            hazards=request.hazards,
            held=request.held,
        )
        with in_run_directory(run.folder):
            jobs = (*jobs_of(place, robot, run.folder), *run.client_jobs())
            expect_room(run.folder, len(jobs))
        led.start(jobs)
        notice = CompilingNotice(place, jobs[0].log, attendant.report)

        def simulated() -> bool:
            notice.look()
            return truth.look()

        begun = led.wait_for(simulated, run.stop, what="the simulator starts", most_s=PLANT_S)
        interrupted = not begun or run.follow(led, meanwhile=truth.look)
        travel = truth.travel
        truth.close()
    arrival = run.arrival(truth.places[-1] if truth.places else None)
    return Driven(run.summary(interrupted, travel), arrival, (building,), {building.name: truth.places})


def run_there(compiled: Compiled, place: Place, request: RunRequest, attendant: Attendant) -> Driven:
    """Run a program on a robot whose servers run already, on this machine or behind a gateway.

    Raises:
        MisuseError: the robot does not run on this machine, or the way does not exist.
        others: as `run_here`.
    """
    if isinstance(place, Local) and not place.directory.running():
        robots = ", ".join(running_robots()) or "none"
        raise MisuseError(
            f"colony: error: nothing of `{place.robot}` runs on this machine (robots found: {robots}); "
            f"start it with `colony serve all --robot {place.robot} --map MAP`"
        )
    way = None
    if request.goal is not None:
        from colony.robots.way import way_of

        way = way_of(request)
    run = _Run(compiled, place, request, attendant, way)
    with run.led() as led:
        with _in_folder(place, run.folder):
            jobs = run.client_jobs()
            expect_room(run.folder, len(jobs))
        led.start(jobs)
        led.hold(request.held)
        interrupted = run.follow(led)
    return Driven(run.summary(interrupted, None), run.arrival(None))


def _way_here(request: RunRequest) -> Way:
    """Return the way to drive; the simulator of processes has a single floor."""
    from colony.robots.way import way_of

    way = way_of(request)
    if len(way.plan.floors) > 1:
        floors = " to ".join(way.plan.floors)
        raise MisuseError(
            f"{request.map_path}: error: the way leads from {floors}, and a simulated robot of processes "
            "stays on its floor; leave out --processes to ride elevators"
        )
    return way


class _Run:
    """The common part of both kinds of runs. Mutable: the observations of the run."""

    def __init__(
        self, compiled: Compiled, place: Place, request: RunRequest, attendant: Attendant, way: Way | None
    ) -> None:
        self._place = place
        self._request = request
        self._attendant = attendant
        self._way = way
        self._mission: LiveMission | None = None
        self._compiled, more = compiled, _more_servers(compiled.robot, place)
        self._bindings = bind(compiled.robot, (*SERVERS, *more))
        self._deployed = deployment(
            compiled,
            self._bindings,
            run=f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}",
            seed=request.seed,
            servers=tuple(server.name for server in more),
        )
        self._tally = Tally(compiled)
        self._standings = Standings(self._deployed, file=os.path.abspath(request.file))
        self._window = Window(
            request.length_ns,
            frame_ns=compiled.frame_ns,
            sinks=(self._tally, self._standings, attendant.progress(request.length_ns)),
        )
        self._folder: Path | None = None
        self._recording: RunRecording | None = None
        self._interrupted: Callable[[], bool] = lambda: False

    @contextmanager
    def led(self) -> Iterator[LedRun]:
        """Lead the run to the end of the `with`; its processes have ended then."""
        with self._attendant.interruptible() as self._interrupted, ExitStack() as holds:
            led = holds.enter_context(self._lead())
            self._folder = self._fresh_folder()
            if self._request.record is not None:
                self._recording = self._begin_recording(self._request.record)
                self._window.record(self._recording)
            try:
                yield led
                holds.close()
            except RunFailedError as problem:
                raise RunAbortedError(str(problem)) from None
        if self._recording is not None:
            self._recording.expect_frames()

    def stop(self) -> bool:
        """Return True if the run has to end early: it was interrupted, or its recording broke off."""
        return self._interrupted() or self._broke_off is not None

    @property
    def _broke_off(self) -> str | None:
        return None if self._recording is None else self._recording.broken_off

    @property
    def folder(self) -> Path:
        """The folder of its processes' specs and logs."""
        assert self._folder is not None
        return self._folder

    def client_jobs(self) -> tuple[Job, ...]:
        """Return the jobs of its clients; Python modules are found on this process's paths."""
        search = (str(Path(self._request.file).resolve().parent), os.getcwd())
        return client_jobs(
            self._place,
            self._deployed,
            self._compiled,
            self._bindings,
            self.folder,
            search,
            isolate=self._request.isolate,
        )

    def follow(self, led: LedRun, *, meanwhile: Callable[[], object] = lambda: None) -> bool:
        """Lead the run to its end, or to that of its way; return True if it was interrupted before."""
        if self._way is None:
            return not led.follow(self.stop, meanwhile=meanwhile)
        from colony.robots.live_mission import LiveMission

        way, operator = self._way, None
        if len(way.plan.floors) > 1:
            operator = self._attendant.operator(way.building)
        with session_with(self._place) as session:
            self._mission = LiveMission(session, way.building, way.plan, operator=operator)
            with self._mission as mission:
                led.follow(lambda: self.stop() or mission.over, meanwhile=meanwhile)
                return self.stop() and not mission.over

    def arrival(self, place: tuple[float, float] | None) -> Arrival | None:
        """Return the result of the way, None for a run without one.

        `place` is the robot's true place, if it is known.
        """
        if self._way is None or self._mission is None:
            return None
        from colony.robots.way import TOLD_OF_PLATE

        mission, name = self._mission, self._way.name
        off_mm, by = mission.off_mm, " as it reckons"
        if place is not None:
            goal = self._way.plan.segments[-1].end
            off_mm, by = math.hypot(place[0] - goal.x_mm, place[1] - goal.y_mm), ""
        when, where = f"after {mission.took_s:.1f} s", f"{off_mm / 1000:.2f} m from the goal{by}"
        if mission.problem:
            text = f"{name}: broke off {when}, {where}: {mission.problem}"
        else:
            text = f"{name}: {'arrived' if mission.arrived else 'not done'} {when}, {where}"
            text += TOLD_OF_PLATE[mission.verdict]
        return Arrival(arrived=mission.arrived, text=text)

    def summary(self, interrupted: bool, travel: Travel | None) -> RunSummary:
        """Return the summary of the run."""
        found = self._tally.summary(
            seed=self._request.seed,
            duration_s=self._window.shown_ns / 1e9,
            interrupted=interrupted and self._interrupted(),
            travel=travel,
        )
        return replace(found, broke_off=self._broke_off)

    def _lead(self) -> LedRun:
        recorded = self._request.record is not None
        observer = build_observer(
            self._compiled, self._bindings, (self._window,), self._deployed.run, requests=recorded
        )
        servers = dict.fromkeys([CLOCK, DSERVER.name, *(b.server for b in self._bindings.actuators)])
        return LedRun(
            self._place,
            self._deployed,
            servers,
            observer=observer,
            window=self._window,
            standings=self._standings,
            ended=self._tidy,
            report=self._attendant.report,
        )

    def _fresh_folder(self) -> Path:
        """Return an empty folder for the run; no other leader can be using it now."""
        if isinstance(self._place, Local):
            folder = self._place.directory.path / "run"
            with in_run_directory(folder):
                return fresh_folder(folder)
        return Path(mkdtemp(prefix="colony-run-"))

    def _tidy(self) -> None:
        """Clean up after the processes: keep only their logs, and those only on the robot's machine."""
        if self._folder is not None:
            if isinstance(self._place, Local):
                keep_logs(self._folder)
            else:
                shutil.rmtree(self._folder, ignore_errors=True)

    def _begin_recording(self, path: str) -> RunRecording:
        run, started = self._deployed.run, time.strftime("%Y-%m-%dT%H:%M:%S%z")
        return recording_into(path, self._compiled, seed=self._request.seed, run=run, started=started)


def _in_folder(place: Place, folder: Path) -> AbstractContextManager[None]:
    """Return a context that adds advice about a run's folder to an OSError."""
    return in_run_directory(folder) if isinstance(place, Local) else naming(folder)


def _more_servers(robot: Robot, place: Place) -> tuple[ServerSpec, ...]:
    """Return the additional servers that the program's sensors read, by their own description.

    Servers that do not run, or do not describe themselves, are left out.
    """
    known = {server.name for server in SERVERS}
    wanted = dict.fromkeys(s.server for s in robot.sensors if s.server not in known)
    if not wanted:
        return ()
    from colony.runtime.kit.description import describe, server_spec
    from colony.runtime.kit.errors import RobotConnectionError

    found = []
    with suppress(RobotConnectionError), session_with(place) as session:
        for name in wanted:
            with suppress(RobotConnectionError, ValueError), session.connect(name) as connection:
                found.append(server_spec(connection.do(describe())))
    return tuple(found)
