"""A run of a program in several processes: its clients, and servers that it starts or that already run."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

from colony.execute.compiled import Compiled
from colony.ir.program import Robot
from colony.ir.servers import COMMON_SERVERS, DSERVER, ServerSpec
from colony.ir.types import Value
from colony.os_errors import naming
from colony.robots.described import DescribedRobot
from colony.robots.discovery import running_robots, session_with
from colony.robots.driver_watch import DriverWatch
from colony.robots.field_giver import FieldGiver
from colony.robots.recording import RunRecording, recording_into
from colony.robots.request import (
    MissionResult,
    MisuseError,
    RunAbortedError,
    RunReport,
    RunRequest,
    UserInterface,
)
from colony.robots.scenario import Scenario, player
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.assembly.processes.children import Job
from colony.runtime.assembly.processes.jobs import (
    check_disk_space,
    client_jobs,
    delete_all_but_logs,
    fresh_folder,
)
from colony.runtime.assembly.processes.run import RunFailedError, SupervisedRun
from colony.runtime.assembly.processes.run_status import RunStatusTracker
from colony.runtime.assembly.processes.window import Window
from colony.runtime.observe.summary import RunSummary, Tally, Travel
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.robot_address import Local, RobotAddress
from colony.runtime.transport.live.run_directory import in_run_directory
from colony.sim.plant.child import SIMULATOR

if TYPE_CHECKING:  # imported only for a run with a mission
    from colony.robots.live_mission import LiveMission
    from colony.robots.route import Route

PLANT_START_TIMEOUT_S = 120.0
"""Timeout in seconds for the simulator to start; without a cache it is compiled first."""

PLANT_ANSWER_TIMEOUT_S = 10.0
"""Timeout in seconds for a simulator that already runs to answer."""


def run_simulated(
    compiled: Compiled,
    described: DescribedRobot,
    robot_address: Local,
    request: RunRequest,
    ui: UserInterface,
) -> RunReport:
    """Run a program on a simulated robot: start servers, clients and the plant, and end them with the run.

    Raises:
        MisuseError: the route does not exist, or no recording can be written.
        DiagnosticError: the map is invalid (codes beginning with M), or the program needs something that the
            robot lacks.
        LiveError: the robot cannot be used; for example, another run of it is in progress.
        RunAbortedError: the run could not begin, or broke off.
    """
    from colony.nav.maps.world_map import load_world
    from colony.robots.simulated import CompilationNotice, SimulatedRobot, TruthLog, jobs_of

    assert request.map_path is not None
    route = _single_floor_route(request) if request.goal is not None else None
    run = _Run(compiled, described, robot_address, request, ui, route)
    cameras = dict(request.cameras)
    if route is not None:
        from colony.robots.variants import CEILING_CAMERA

        cameras = {CEILING_CAMERA: "up", **cameras}
    world = load_world(request.map_path)
    if cameras:
        world.building("a camera")
    truth = TruthLog(robot_address)
    with run.supervised() as supervised_run, run.giving() as give:
        robot = SimulatedRobot(
            described=described,
            map_path=request.map_path,
            seed=request.seed,
            state=run.folder,
            cameras=cameras,
            fsync=request.fsync,
            start=request.start if route is None else route.start,
            hazards=request.hazards,
            movers=request.movers,
            pinned_variables=request.pinned_variables,
        )
        with in_run_directory(run.folder):
            jobs = (*jobs_of(robot_address, robot, run.folder), *run.client_jobs())
            check_disk_space(run.folder, len(jobs))
        supervised_run.start(jobs)
        notice = CompilationNotice(robot_address, jobs[0].log, ui.report)

        def follow_plant() -> bool:
            given = give()
            return truth.poll() and given

        def simulated() -> bool:
            notice.poll()
            return follow_plant()

        has_begun = supervised_run.wait_for(
            simulated, run.stop, what="the start of the simulator", timeout_s=PLANT_START_TIMEOUT_S
        )
        run.set_variables(supervised_run, {})
        interrupted = not has_begun or run.follow(supervised_run, meanwhile=follow_plant)
        travel = truth.travel
        truth.close()
    mission_result = run.mission_result(truth.points[-1] if truth.points else None)
    return RunReport(run.summary(interrupted, travel), mission_result, (world,), {world.name: truth.points})


def run_served(
    compiled: Compiled,
    described: DescribedRobot,
    robot_address: RobotAddress,
    request: RunRequest,
    ui: UserInterface,
) -> RunReport:
    """Run a program on a robot that is already running, on this machine or behind a gateway.

    Raises:
        MisuseError: the robot does not run on this machine, the route does not exist, or the scenario gives
            what only a simulator on this machine can give.
        DiagnosticError, LiveError, RunAbortedError: see `run_simulated`.
    """
    if isinstance(robot_address, Local) and not robot_address.directory.running():
        robots = ", ".join(running_robots()) or "none"
        raise MisuseError(
            f"colony: error: no process of `{robot_address.robot}` runs on this machine "
            f"(running robots: {robots}); "
            f"start it with `colony serve all --robot {robot_address.robot} --map MAP`"
        )
    _expect_givable(robot_address, request)
    route = None
    if request.goal is not None:
        from colony.robots.route import planned_route

        route = planned_route(request)
    run = _Run(compiled, described, robot_address, request, ui, route)
    drivers = DriverWatch(robot_address, _bound_servers(compiled.robot), ui.report)
    with closing(drivers), run.supervised() as supervised_run, run.giving() as give:
        supervised_run.wait_for(
            give, run.stop, what="an answer of the simulator", timeout_s=PLANT_ANSWER_TIMEOUT_S
        )
        with _in_folder(robot_address, run.folder):
            jobs = run.client_jobs()
            check_disk_space(run.folder, len(jobs))
        supervised_run.start(jobs)
        run.set_variables(supervised_run, request.pinned_variables)
        interrupted = run.follow(supervised_run, meanwhile=give)
    summary = replace(run.summary(interrupted, None), driver_failures=drivers.failures)
    return RunReport(summary, run.mission_result(None))


def _expect_givable(robot_address: RobotAddress, request: RunRequest) -> None:
    """Check that what the scenario gives to devices can be given: their simulator runs on this machine.

    Raises:
        MisuseError: it does not.
    """
    fields = () if request.scenario is None else request.scenario.fields
    if fields and not (isinstance(robot_address, Local) and SIMULATOR in robot_address.directory.running()):
        raise MisuseError(
            f"colony: error: `{fields[0].sensor.name}` cannot be given: no {SIMULATOR} of "
            f"`{robot_address.robot}` runs on this machine"
        )


def _single_floor_route(request: RunRequest) -> Route:
    """Return the route to drive; with processes the simulator has a single floor."""
    from colony.robots.route import planned_route

    route = planned_route(request)
    if len(route.plan.floors) > 1:
        floors = " to ".join(route.plan.floors)
        raise MisuseError(
            f"{request.map_path}: error: the route leads from {floors}, but with --processes the simulated "
            "robot stays on its floor; leave out --processes to ride elevators"
        )
    return route


class _Run:
    """The common part of runs on simulated and on running robots. Mutable."""

    def __init__(
        self,
        compiled: Compiled,
        described: DescribedRobot,
        robot_address: RobotAddress,
        request: RunRequest,
        ui: UserInterface,
        route: Route | None,
    ) -> None:
        self._robot_address = robot_address
        self._request = request
        self._ui = ui
        self._route = route
        self._scenario = request.scenario or Scenario()
        self._mission: LiveMission | None = None
        self._compiled = compiled
        more = additional_servers(compiled.robot, described, robot_address)
        self._bindings = bind(compiled.robot, (*described.servers, *more))
        self._deployed = deployment(
            compiled,
            self._bindings,
            run=f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}",
            seed=request.seed,
            servers=_bound_servers(compiled.robot),
        )
        self._tally = Tally(compiled)
        self._status_tracker = RunStatusTracker(
            self._deployed,
            file=os.path.abspath(request.file),
            params="" if compiled.site is None else os.path.abspath(compiled.site.file),
            compiled=compiled,
        )
        self._window = Window(
            request.length_ns,
            frame_ns=compiled.frame_ns,
            sinks=(self._tally, self._status_tracker, ui.progress(request.length_ns)),
        )
        for sink in ui.sinks:
            self._window.record(sink)
        self._folder: Path | None = None
        self._recording: RunRecording | None = None
        self._interrupted: Callable[[], bool] = lambda: False

    @contextmanager
    def supervised(self) -> Iterator[SupervisedRun]:
        """Lead the run inside the `with`; at its end, end all processes of the run."""
        with self._ui.interruptible() as self._interrupted, ExitStack() as resources:
            supervised_run = resources.enter_context(self._lead())
            self._folder = self._fresh_folder()
            if self._request.record is not None:
                self._recording = self._begin_recording(self._request.record)
                self._window.record(self._recording)
            try:
                yield supervised_run
                resources.close()
            except RunFailedError as problem:
                raise RunAbortedError(str(problem)) from None
        if self._recording is not None:
            self._recording.expect_frames()

    def stop(self) -> bool:
        """Return True if the run must end early: it was interrupted, or its recording broke off."""
        return self._interrupted() or self._broke_off is not None

    @property
    def _broke_off(self) -> str | None:
        return None if self._recording is None else self._recording.truncation

    @property
    def folder(self) -> Path:
        """The folder of the specs and logs of the run's processes."""
        assert self._folder is not None
        return self._folder

    def client_jobs(self) -> tuple[Job, ...]:
        """Return the jobs of the run's clients, which search this process's folders for Python modules."""
        search_path = (str(Path(self._request.file).resolve().parent), os.getcwd())
        return client_jobs(
            self._robot_address,
            self._deployed,
            self._compiled,
            self._bindings,
            self.folder,
            search_path,
            isolate=self._request.isolate,
        )

    @contextmanager
    def giving(self) -> Iterator[Callable[[], bool]]:
        """Let the devices of a simulated robot read what the scenario gives, inside the `with`.

        The context's value is to be called repeatedly; see `FieldGiver.poll`.
        """
        changes, robot_address = self._scenario.fields, self._robot_address
        if not changes:
            yield lambda: True
            return
        assert isinstance(robot_address, Local)
        with closing(FieldGiver(robot_address, changes, lambda: self._window.begin_ns)) as giver:
            yield giver.poll

    def set_variables(self, supervised_run: SupervisedRun, held: Mapping[str, Value]) -> None:
        """Let the run set variables of DServer: `held` to their values, others as the scenario says."""
        changes = self._scenario.variables
        if held or changes:
            supervised_run.play("scenario", lambda: player(changes, lambda: self._window.begin_ns, held))

    def follow(
        self, supervised_run: SupervisedRun, *, meanwhile: Callable[[], object] = lambda: None
    ) -> bool:
        """Lead the run to its end, or to the end of its route; return True if it was stopped before."""
        if self._route is None:
            return not supervised_run.follow(self.stop, meanwhile=meanwhile)
        from colony.robots.live_mission import LiveMission

        route, operator = self._route, None
        if len(route.plan.floors) > 1:
            operator = self._ui.operator(route.building)
        with session_with(self._robot_address) as session:
            self._mission = LiveMission(session, route.building, route.plan, operator=operator)
            with self._mission as mission:
                supervised_run.follow(lambda: self.stop() or mission.over, meanwhile=meanwhile)
                return self.stop() and not mission.over

    def mission_result(self, position: tuple[float, float] | None) -> MissionResult | None:
        """Return the result of the mission, None for a run without one.

        `position` is the robot's true position, if it is known.
        """
        if self._route is None or self._mission is None:
            return None
        from colony.robots.route import PLATE_TEXTS

        mission, name = self._mission, self._route.name
        goal_error_mm, method = mission.goal_error_mm, " by its odometry"
        if position is not None:
            goal = self._route.plan.segments[-1].end
            goal_error_mm, method = math.hypot(position[0] - goal.x_mm, position[1] - goal.y_mm), ""
        when, where = (
            f"after {mission.duration_s:.1f} s",
            f"{goal_error_mm / 1000:.2f} m from the goal{method}",
        )
        if mission.problem:
            text = f"{name}: broke off {when}, {where}: {mission.problem}"
        else:
            text = f"{name}: {'arrived' if mission.arrived else 'not done'} {when}, {where}"
            text += PLATE_TEXTS[mission.verdict]
        return MissionResult(arrived=mission.arrived, text=text)

    def summary(self, interrupted: bool, travel: Travel | None) -> RunSummary:
        """Return the summary of the run."""
        summary = self._tally.summary(
            seed=self._request.seed,
            duration_s=self._window.shown_ns / 1e9,
            interrupted=interrupted and self._interrupted(),
            travel=travel,
        )
        return replace(summary, broke_off=self._broke_off)

    def _lead(self) -> SupervisedRun:
        recorded = self._request.record is not None
        observer = build_observer(
            self._compiled, self._bindings, (self._window,), self._deployed.run, requests=recorded
        )
        servers = dict.fromkeys([CLOCK, DSERVER.name, *(b.server for b in self._bindings.actuators)])
        return SupervisedRun(
            self._robot_address,
            self._deployed,
            servers,
            observer=observer,
            window=self._window,
            status_tracker=self._status_tracker,
            on_end=self._clean_up,
            report=self._ui.report,
        )

    def _fresh_folder(self) -> Path:
        """Return an empty folder for the run, which no other leader uses."""
        if isinstance(self._robot_address, Local):
            folder = self._robot_address.directory.path / "run"
            with in_run_directory(folder):
                return fresh_folder(folder)
        return Path(mkdtemp(prefix="colony-run-"))

    def _clean_up(self) -> None:
        """Delete the files of the processes, except their logs if the robot is on this machine."""
        if self._folder is not None:
            if isinstance(self._robot_address, Local):
                delete_all_but_logs(self._folder)
            else:
                shutil.rmtree(self._folder, ignore_errors=True)

    def _begin_recording(self, path: str) -> RunRecording:
        run, started = self._deployed.run, time.strftime("%Y-%m-%dT%H:%M:%S%z")
        return recording_into(path, self._compiled, seed=self._request.seed, run=run, started=started)


def _in_folder(robot_address: RobotAddress, folder: Path) -> AbstractContextManager[None]:
    """Return a context that adds advice about a run's folder to an OSError."""
    return in_run_directory(folder) if isinstance(robot_address, Local) else naming(folder)


def _bound_servers(robot: Robot) -> tuple[str, ...]:
    """Return the servers of sensors and actuators that not every robot has."""
    common = {server.name for server in COMMON_SERVERS}
    bound = (*(s.server for s in robot.sensors), *(a.server for a in robot.actuators))
    return tuple(dict.fromkeys(server for server in bound if server not in common))


def additional_servers(
    robot: Robot, described: DescribedRobot, robot_address: RobotAddress
) -> tuple[ServerSpec, ...]:
    """Return the servers of sensors and actuators that the description lacks, as they describe themselves.

    Servers that do not run, or have no valid description, are left out.
    """
    known_servers = {server.name for server in described.servers}
    additional_names = [name for name in _bound_servers(robot) if name not in known_servers]
    if not additional_names:
        return ()
    from colony.runtime.kit.description import describe, server_spec
    from colony.runtime.kit.errors import RobotConnectionError

    specs = []
    with suppress(RobotConnectionError), session_with(robot_address) as session:
        for name in additional_names:
            with suppress(RobotConnectionError, ValueError), session.connect(name) as connection:
                specs.append(server_spec(connection.do(describe())))
    return tuple(specs)
