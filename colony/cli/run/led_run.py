"""A run of a program in several processes: its clients, and servers that it starts or that already run."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

from colony.cli.run.driver_watch import DriverWatch
from colony.cli.run.simulator import (
    CompilationNotice,
    FieldGiver,
    TruthLog,
    is_simulator_starting,
    simulated_operator,
    start_remarks,
)
from colony.execute.compiled import Compiled
from colony.files import naming
from colony.ir.servers import DSERVER
from colony.ir.types import Value
from colony.runs.described import DescribedRobot, additional_servers
from colony.runs.recording import LiveRun, RunRecording, new_run_name, recording_into
from colony.runs.scenario import Scenario, player
from colony.runs.spec import MissionResult, MisuseError, RunAbortedError, RunReport, RunSpec, UserInterface
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.assembly.processes.children import RunFailedError
from colony.runtime.assembly.processes.jobs import (
    Layout,
    Processes,
    check_disk_space,
    client_processes,
    delete_all_but_logs,
    fresh_folder,
)
from colony.runtime.assembly.processes.run import SupervisedRun
from colony.runtime.assembly.processes.run_status import RunStatusTracker
from colony.runtime.assembly.processes.window import RecordingWindow
from colony.runtime.kit.discovery import session_with
from colony.runtime.observe.observer import BackgroundSink
from colony.runtime.observe.stillness import Stillness
from colony.runtime.observe.summary import RunSummary, Tally, Travel
from colony.runtime.protocol.bindings import bind, bound_servers
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.robot_address import Local, RobotAddress
from colony.runtime.transport.live.run_directory import in_run_directory
from colony.sim.plant.child import SIMULATOR

if TYPE_CHECKING:
    from colony.nav.maps.building import Building
    from colony.nav.maps.world_map import WorldMap
    from colony.runs.live_mission import LiveMission
    from colony.runs.navigation import Route
    from colony.runtime.kit.script import Script
    from colony.sim.plant.protocol import Truth
    from colony.sim.world_spec import WorldSpec


class LedRun:
    """A run on a simulated robot, or on one that is already running. Mutable."""

    def __init__(
        self,
        compiled: Compiled,
        described: DescribedRobot,
        robot_address: RobotAddress,
        spec: RunSpec,
        ui: UserInterface,
        route: Route | None,
    ) -> None:
        self._robot_address = robot_address
        self._spec = spec
        self._ui = ui
        self._route = route
        self._scenario = spec.scenario or Scenario()
        self._mission: LiveMission | None = None
        self._compiled = compiled
        additional = additional_servers(compiled.robot, described, robot_address)
        self._bindings = bind(compiled.robot, (*described.servers, *additional))
        self._deployed = deployment(
            compiled,
            self._bindings,
            run=new_run_name(),
            seed=spec.world.seed,
            servers=bound_servers(compiled.robot),
        )
        self._tally = Tally(compiled)
        self._stillness = Stillness(compiled, ui.stands)
        self._status_tracker = RunStatusTracker(
            self._deployed,
            file=os.path.abspath(spec.file),
            params="" if compiled.site is None else os.path.abspath(compiled.site.file),
            compiled=compiled,
            still=lambda: self._stillness.cause,
        )
        self._window = RecordingWindow(
            spec.length_ns,
            frame_ns=compiled.frame_ns,
            sinks=(
                self._tally,
                self._stillness,
                self._status_tracker,
                BackgroundSink(ui.progress(spec.length_ns), dispensable=True),
            ),
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
            if self._spec.record is not None:
                self._recording = self._begin_recording(self._spec.record)
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

    @property
    def layout(self) -> Layout:
        """Where the nodes of the run are: on a mission, this process computes poses and looks at images."""
        if self._spec.isolate:
            return "isolated"
        return "hosted" if self._route is None else "composed"

    def client_processes(self) -> Processes:
        """Return the processes of the clients, which search this process's folders for Python modules."""
        search_path = (str(Path(self._spec.file).resolve().parent), os.getcwd())
        return client_processes(
            self._robot_address,
            self._deployed,
            self._compiled,
            self._bindings,
            self.folder,
            search_path,
            layout=self.layout,
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

    def elapsed_s(self, t_ns: int) -> float | None:
        """Return the time since the beginning of the run at a time of the simulator; None before."""
        began_ns = self._window.begin_ns
        if began_ns is None or not isinstance(self._robot_address, Local):
            return None
        return (t_ns - began_ns - self._origin_ns) / 1e9

    @cached_property
    def _origin_ns(self) -> int:
        """The origin of the robot's time; the robot is on this machine."""
        assert isinstance(self._robot_address, Local)
        return self._robot_address.directory.origin_ns()

    def set_variables(self, supervised_run: SupervisedRun, held: Mapping[str, Value]) -> None:
        """Let the run set variables of DServer: `held` to their values, others as the scenario says."""
        changes = self._scenario.variables
        if held or changes:
            supervised_run.play("scenario", lambda: player(changes, lambda: self._window.begin_ns, held))

    def follow(
        self,
        supervised_run: SupervisedRun,
        operator: Callable[[Building], AbstractContextManager[Script]],
        *,
        meanwhile: Callable[[], object],
    ) -> bool:
        """Lead the run to its end, or to the end of its route; return True if it was stopped before.

        Args:
            supervised_run: the run.
            operator: function that returns the operator of a building's elevators, for routes that take some.
            meanwhile: callback that is called repeatedly.
        """
        if self._route is None:
            return not supervised_run.follow(self.stop, meanwhile=meanwhile)
        from colony.runs.live_mission import LiveMission

        route = self._route
        with ExitStack() as resources:
            operating = None
            if len(route.plan.floors) > 1:
                operating = resources.enter_context(operator(route.building))
            session = resources.enter_context(session_with(self._robot_address))
            self._mission = LiveMission(session, route.building, route.plan, operator=operating)
            with self._mission as mission:
                supervised_run.follow(lambda: self.stop() or mission.over, meanwhile=meanwhile)
                return self.stop() and not mission.over

    def mission_result(self, truth: Truth | None) -> MissionResult | None:
        """Return the result of the mission, None for a run without one.

        `truth` is the robot's true state, if it is known.
        """
        if self._route is None or self._mission is None:
            return None
        from colony.runs.navigation import Ending, mission_result

        mission, goal = self._mission, self._route.plan.segments[-1].end
        ending = Ending(
            is_done=mission.arrived,
            problem=mission.problem,
            duration_s=mission.duration_s,
            floor=mission.floor,
            goal_error_mm=mission.goal_error_mm,
            source="its odometry",
            verdict=mission.verdict,
        )
        if truth is not None:
            error_mm = math.hypot(truth.x - goal.x_mm, truth.y - goal.y_mm)
            ending = replace(ending, floor=truth.floor, goal_error_mm=error_mm, source="")
        return mission_result(self._route, ending)

    def summary(self, interrupted: bool, travel: Travel | None) -> RunSummary:
        """Return the summary of the run."""
        summary = self._tally.summary(
            seed=self._spec.world.seed,
            duration_s=self._window.shown_ns / 1e9,
            interrupted=interrupted and self._interrupted(),
            travel=travel,
        )
        return replace(summary, broke_off=self._broke_off, unread=self._stillness.unread)

    def _lead(self) -> SupervisedRun:
        recorded = self._spec.record is not None
        observer = build_observer(
            self._compiled,
            self._bindings,
            (BackgroundSink(self._window),),
            self._deployed.run,
            requests=recorded,
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
        robot, live = self._robot_address.robot, LiveRun(self._deployed.run)
        return recording_into(path, self._compiled, seed=self._spec.world.seed, robot=robot, live=live)


PLANT_START_TIMEOUT_S = 600.0
"""Timeout in seconds for the simulator to start; slow computers compile it for minutes."""

PLANT_ANSWER_TIMEOUT_S = 10.0
"""Timeout in seconds for a simulator that already runs to answer."""


def run_simulated(
    compiled: Compiled,
    described: DescribedRobot,
    robot_address: Local,
    spec: RunSpec,
    ui: UserInterface,
) -> RunReport:
    """Run a program on a simulated robot: start servers, clients and the plant, and end them with the run.

    Raises:
        MisuseError: the route does not exist or is not for this robot, or no recording can be written.
        DiagnosticError: the map is invalid (codes beginning with M), or the program needs something that the
            robot lacks.
        LiveError: the robot cannot be used; for example, another run of it is in progress.
        RunAbortedError: the run could not begin, or broke off.
    """
    from colony.cli.serve.processes import ServeSpec, processes_of
    from colony.nav.maps.driven_path import MapExit
    from colony.sim.plant.servers import PlantDevices

    assert spec.world.map_path is not None
    route = None
    if spec.goal is not None:
        from colony.runs.navigation import expect_rome, planned_route

        expect_rome(described.body)
        route = planned_route(spec)
    run = LedRun(compiled, described, robot_address, spec, ui, route)
    floors, world = _floors(spec.world.map_path, route), _world_on(route, spec.world)
    if world.cameras:
        floors[0].building("a camera")
    truth, map_exit = TruthLog(robot_address), MapExit(floors[0])
    if route is None:
        for remark in start_remarks(floors[0], described.body, spec.world.start):
            ui.report(remark)
    with run.supervised() as supervised_run, run.giving() as give:
        served = ServeSpec(
            described=described,
            world=world,
            state=run.folder,
            fsync=spec.fsync,
            pinned_variables=spec.pinned_variables,
        )
        with in_run_directory(run.folder):
            servers = processes_of(robot_address, served, run.folder, layout=run.layout)
            clients = run.client_processes()
            jobs = (*servers.jobs, *clients.jobs)
            check_disk_space(run.folder, len(jobs))
        supervised_run.start(jobs)
        supervised_run.host((*servers.hosted, *clients.hosted), PlantDevices())
        notice = CompilationNotice(robot_address, jobs[0].log, ui.report)

        def follow_plant() -> bool:
            given = give()
            is_seen, last = truth.poll(), truth.last
            if last is not None and (t_s := run.elapsed_s(last.t_ns)) is not None:
                map_exit.add(t_s, last.x, last.y)
            return is_seen and given

        def simulated() -> bool:
            notice.poll()
            return follow_plant()

        has_begun = supervised_run.wait_for(
            simulated, run.stop, what="the start of the simulator", timeout_s=PLANT_START_TIMEOUT_S
        )
        run.set_variables(supervised_run, {})
        interrupted = not has_begun or run.follow(
            supervised_run,
            lambda building: simulated_operator(robot_address, served, building),
            meanwhile=follow_plant,
        )
        travel = replace(truth.travel, off_map=map_exit.off_map)
        truth.close()
    summary, result = run.summary(interrupted, travel), run.mission_result(truth.last)
    return RunReport(summary, result, floors, truth.paths, people=truth.people.points)


def _floors(map_path: str, route: Route | None) -> tuple[WorldMap, ...]:
    """Return the floors of a simulated run, the robot's one first."""
    from colony.nav.maps.world_map import load_world, world_of

    if route is None:
        return (load_world(map_path),)
    return tuple(world_of(route.building.map_named(name)) for name in route.plan.floors)


def _world_on(route: Route | None, world: WorldSpec) -> WorldSpec:
    """Return the world with what a route requires: its floors, its start, and the cameras of RoME."""
    if route is None:
        return world
    from colony.runs.navigation import CEILING_CAMERA, FRONT_CAMERA

    floors, ahead = route.plan.floors, {FRONT_CAMERA: 0.0}  # for the markers of elevators
    cameras = {CEILING_CAMERA: "up", **(ahead if len(floors) > 1 else {}), **world.cameras}
    return world.changed(floors=floors, start=route.plan.start, cameras=cameras)


def run_served(
    compiled: Compiled,
    described: DescribedRobot,
    robot_address: RobotAddress,
    spec: RunSpec,
    ui: UserInterface,
) -> RunReport:
    """Run a program on a robot that is already running, on this machine or behind a gateway.

    Raises:
        MisuseError: the route does not exist, or the scenario gives what only a simulator on this machine
            can give.
        DiagnosticError, LiveError, RunAbortedError: see `run_simulated`.
    """
    _expect_givable(robot_address, spec)
    route = None
    if spec.goal is not None:
        from colony.runs.navigation import planned_route

        route = planned_route(spec)
    run = LedRun(compiled, described, robot_address, spec, ui, route)
    drivers = DriverWatch(robot_address, bound_servers(compiled.robot), ui.report)
    with closing(drivers), run.supervised() as supervised_run, run.giving() as give:
        is_there = _wait_for_simulator(robot_address, supervised_run, run.stop, ui)
        has_begun = is_there and supervised_run.wait_for(
            give, run.stop, what="an answer of the simulator", timeout_s=PLANT_ANSWER_TIMEOUT_S
        )
        with _in_folder(robot_address, run.folder):
            clients = run.client_processes()
            check_disk_space(run.folder, len(clients.jobs))
        supervised_run.start(clients.jobs)
        supervised_run.host(clients.hosted)
        run.set_variables(supervised_run, spec.pinned_variables)
        interrupted = not has_begun or run.follow(
            supervised_run, lambda building: nullcontext(ui.operator(building)), meanwhile=give
        )
    summary = replace(run.summary(interrupted, None), driver_failures=drivers.failures)
    return RunReport(summary, run.mission_result(None))


def _wait_for_simulator(
    robot_address: RobotAddress, supervised_run: SupervisedRun, stop: Callable[[], bool], ui: UserInterface
) -> bool:
    """Wait until a simulator that is being started takes drivers; return False if `stop` ended the wait.

    Without it the run would begin without values of sensors. After `PLANT_START_TIMEOUT_S` it does.
    """
    if not is_simulator_starting(robot_address):
        return True
    ui.report(f"waiting for the {SIMULATOR} of {robot_address.robot}, which is being started")
    give_up_s = time.monotonic() + PLANT_START_TIMEOUT_S
    return supervised_run.wait_for(
        lambda: not is_simulator_starting(robot_address) or time.monotonic() > give_up_s,
        stop,
        what=f"the start of the {SIMULATOR}",
        timeout_s=math.inf,
    )


def _expect_givable(robot_address: RobotAddress, spec: RunSpec) -> None:
    """Check that what the scenario gives to devices can be given: their simulator runs on this machine.

    Raises:
        MisuseError: it does not.
    """
    fields = () if spec.scenario is None else spec.scenario.fields
    if not fields or is_simulator_starting(robot_address):
        return
    if not (isinstance(robot_address, Local) and SIMULATOR in robot_address.directory.running()):
        raise MisuseError(
            f"colony: error: `{fields[0].sensor.name}` cannot be given: no {SIMULATOR} of "
            f"`{robot_address.robot}` runs on this machine"
        )


def _in_folder(robot_address: RobotAddress, folder: Path) -> AbstractContextManager[None]:
    """Return a context that adds advice about a run's folder to an OSError."""
    return in_run_directory(folder) if isinstance(robot_address, Local) else naming(folder)
