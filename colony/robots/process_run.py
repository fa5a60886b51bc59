"""A run of a program in several processes: its clients, and servers that it starts or that already run."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from colony.execute.compiled import Compiled
from colony.files import naming
from colony.robots.bound_servers import expect_running
from colony.robots.described import DescribedRobot
from colony.robots.driver_watch import DriverWatch
from colony.robots.led_run import LedRun
from colony.robots.request import MisuseError, RunReport, RunRequest, UserInterface
from colony.robots.simulated import is_simulator_starting
from colony.runtime.assembly.processes.jobs import check_disk_space
from colony.runtime.assembly.processes.run import SupervisedRun
from colony.runtime.protocol.bindings import bound_servers
from colony.runtime.transport.live.robot_address import Local, RobotAddress
from colony.runtime.transport.live.run_directory import in_run_directory
from colony.sim.plant.child import SIMULATOR

if TYPE_CHECKING:  # imported only for runs that need them
    from colony.nav.maps.world_map import WorldMap
    from colony.robots.route import Route
    from colony.sim.plant.child import ViewDirection

PLANT_START_TIMEOUT_S = 600.0
"""Timeout in seconds for the simulator to start; slow computers compile it for minutes."""

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
        MisuseError: the route does not exist or is not for this robot, or no recording can be written.
        DiagnosticError: the map is invalid (codes beginning with M), or the program needs something that the
            robot lacks.
        LiveError: the robot cannot be used; for example, another run of it is in progress.
        RunAbortedError: the run could not begin, or broke off.
    """
    from colony.robots.driven_path import MapExit
    from colony.robots.simulated import (
        CompilationNotice,
        SimulatedRobot,
        TruthLog,
        processes_of,
        simulated_operator,
        start_remarks,
    )
    from colony.sim.plant.servers import PlantDevices

    assert request.map_path is not None
    route = None
    if request.goal is not None:
        from colony.robots.route import expect_rome, planned_route

        expect_rome(described.body)
        route = planned_route(request)
    run = LedRun(compiled, described, robot_address, request, ui, route)
    floors = _floors(request.map_path, route)
    cameras = {**_mission_cameras(route), **request.cameras}
    if cameras:
        floors[0].building("a camera")
    truth, map_exit = TruthLog(robot_address), MapExit(floors[0])
    if route is None:
        for remark in start_remarks(floors[0], described.body, request.start):
            ui.report(remark)
    with run.supervised() as supervised_run, run.giving() as give:
        robot = SimulatedRobot(
            described=described,
            map_path=request.map_path,
            floors=() if route is None else route.plan.floors,
            seed=request.seed,
            state=run.folder,
            cameras=cameras,
            fsync=request.fsync,
            start=request.start if route is None else route.plan.start,
            hazards=request.hazards,
            movers=request.movers,
            pinned_variables=request.pinned_variables,
        )
        with in_run_directory(run.folder):
            servers = processes_of(robot_address, robot, run.folder, layout=run.layout)
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
            lambda building: simulated_operator(robot_address, robot, building),
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


def _mission_cameras(route: Route | None) -> Mapping[str, ViewDirection]:
    """Return the viewing directions of the cameras that a simulated robot needs for a route."""
    if route is None:
        return {}
    from colony.robots.navigation import CEILING_CAMERA, FRONT_CAMERA

    ahead = {FRONT_CAMERA: 0.0} if len(route.plan.floors) > 1 else {}  # for the markers of elevators
    return {CEILING_CAMERA: "up", **ahead}


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
    expect_running(robot_address, described)
    _expect_givable(robot_address, request)
    route = None
    if request.goal is not None:
        from colony.robots.route import planned_route

        route = planned_route(request)
    run = LedRun(compiled, described, robot_address, request, ui, route)
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
        run.set_variables(supervised_run, request.pinned_variables)
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


def _expect_givable(robot_address: RobotAddress, request: RunRequest) -> None:
    """Check that what the scenario gives to devices can be given: their simulator runs on this machine.

    Raises:
        MisuseError: it does not.
    """
    fields = () if request.scenario is None else request.scenario.fields
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
