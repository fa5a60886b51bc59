"""A run of a program in several processes, as its leader conducts it: clients, recording, mission, end."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

from colony.execute.compiled import Compiled
from colony.ir.servers import DSERVER
from colony.ir.types import Value
from colony.robots.bound_servers import additional_servers
from colony.robots.described import DescribedRobot
from colony.robots.discovery import session_with
from colony.robots.field_giver import FieldGiver
from colony.robots.recording import LiveRun, RunRecording, new_run_name, recording_into
from colony.robots.request import MissionResult, RunAbortedError, RunRequest, UserInterface
from colony.robots.scenario import Scenario, player
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.assembly.processes.children import RunFailedError
from colony.runtime.assembly.processes.jobs import (
    Layout,
    Processes,
    client_processes,
    delete_all_but_logs,
    fresh_folder,
)
from colony.runtime.assembly.processes.run import SupervisedRun
from colony.runtime.assembly.processes.run_status import RunStatusTracker
from colony.runtime.assembly.processes.window import RecordingWindow
from colony.runtime.observe.observer import BackgroundSink
from colony.runtime.observe.summary import RunSummary, Tally, Travel
from colony.runtime.protocol.bindings import bind, bound_servers
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.robot_address import Local, RobotAddress
from colony.runtime.transport.live.run_directory import in_run_directory

if TYPE_CHECKING:  # imported only for runs that need them
    from colony.nav.maps.building import Building
    from colony.robots.live_mission import LiveMission
    from colony.robots.route import Route
    from colony.runtime.kit.script import Script
    from colony.sim.plant.protocol import Truth


class LedRun:
    """A run on a simulated robot, or on one that is already running. Mutable."""

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
        additional = additional_servers(compiled.robot, described, robot_address)
        self._bindings = bind(compiled.robot, (*described.servers, *additional))
        self._deployed = deployment(
            compiled,
            self._bindings,
            run=new_run_name(),
            seed=request.seed,
            servers=bound_servers(compiled.robot),
        )
        self._tally = Tally(compiled)
        self._status_tracker = RunStatusTracker(
            self._deployed,
            file=os.path.abspath(request.file),
            params="" if compiled.site is None else os.path.abspath(compiled.site.file),
            compiled=compiled,
        )
        self._window = RecordingWindow(
            request.length_ns,
            frame_ns=compiled.frame_ns,
            sinks=(
                self._tally,
                self._status_tracker,
                BackgroundSink(ui.progress(request.length_ns), dispensable=True),
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

    @property
    def layout(self) -> Layout:
        """Where the nodes of the run are: on a mission, this process computes poses and looks at images."""
        if self._request.isolate:
            return "isolated"
        return "hosted" if self._route is None else "composed"

    def client_processes(self) -> Processes:
        """Return the processes of the clients, which search this process's folders for Python modules."""
        search_path = (str(Path(self._request.file).resolve().parent), os.getcwd())
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
        from colony.robots.live_mission import LiveMission

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
        from colony.robots.mission_result import Ending, mission_result

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
            seed=self._request.seed,
            duration_s=self._window.shown_ns / 1e9,
            interrupted=interrupted and self._interrupted(),
            travel=travel,
        )
        return replace(summary, broke_off=self._broke_off)

    def _lead(self) -> SupervisedRun:
        recorded = self._request.record is not None
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
        return recording_into(path, self._compiled, seed=self._request.seed, robot=robot, live=live)
