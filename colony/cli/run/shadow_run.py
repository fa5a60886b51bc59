"""A run of a program in the shadow of a robot: it decides and records every frame, and commands nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace

from colony.cli.interruption import in_thread
from colony.cli.run.bag_run import unjudged_contracts
from colony.cli.run.driver_watch import DriverWatch
from colony.execute.compiled import Compiled
from colony.ir.servers import DSERVER
from colony.runs.described import DescribedRobot, additional_servers
from colony.runs.recording import LiveRun, RunRecording, new_run_name, recording_into
from colony.runs.ros2_devices import commanded_topics
from colony.runs.spec import RunAbortedError, RunReport, RunSpec, UserInterface
from colony.runtime.assembly.controller import Controller
from colony.runtime.assembly.processes.children import HEALTH_CHECK_INTERVAL_S
from colony.runtime.assembly.processes.run import START_TIMEOUT_S
from colony.runtime.assembly.processes.window import RecordingWindow, WindowWatch
from colony.runtime.assembly.shadow import Shadow
from colony.runtime.kit.connection import Session
from colony.runtime.kit.discovery import session_with
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.hub import Hub
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.kit.script_live import RestartedScript
from colony.runtime.library import clock, data
from colony.runtime.observe.comparison import DEFAULT_TOLERANCE, ControllerComparison
from colony.runtime.observe.observer import Sink
from colony.runtime.observe.summary import Tally
from colony.runtime.protocol.bindings import bind, bound_servers
from colony.runtime.protocol.deployment import Deployment, deployment, problems
from colony.runtime.protocol.interface import interface_problem
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import RobotAddress

BEHIND_NS = 1_000_000_000
"""Nanoseconds behind the robot from which a shadow counts as too slow."""

REPEAT_INTERVAL_S = 1.0
"""Seconds between two requests to DServer to show the variables that the program reads.

A restarted DServer has forgotten the request.
"""


def run_shadow(
    compiled: Compiled,
    described: DescribedRobot,
    robot_address: RobotAddress,
    spec: RunSpec,
    ui: UserInterface,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
) -> RunReport:
    """Run a program in the shadow of a robot that is running, on this machine or behind a gateway.

    It makes only calls that need no more than the right `read`. If another controller commands the robot,
    commands count as the same within the tolerance, in percent of their range.

    Raises:
        MisuseError: no recording can be written.
        DiagnosticError: the program needs something that the robot lacks.
        LiveError: the robot cannot be reached.
        RunAbortedError: the robot would refuse the program, no frame comes, or the Clock stays absent.
    """
    servers = bound_servers(compiled.robot)
    additional = additional_servers(compiled.robot, described, robot_address)
    bindings = bind(compiled.robot, (*described.servers, *additional))
    deployed = deployment(compiled, bindings, run=new_run_name(), seed=spec.world.seed, servers=servers)
    is_read_only = _expect_accepted(robot_address, deployed)
    tally = Tally(compiled)
    recording: RunRecording | None = None
    sinks: tuple[Sink, ...] = (tally, ui.progress(spec.length_ns))
    controller: Controller | None = None
    topics: dict[str, str] = {}
    comparison: ControllerComparison | None = None
    if is_read_only:
        names = commanded_topics(described.body)
        heard = tuple(b for b in bindings.actuators if (b.server, b.command) in names)
        topics = {b.actuator: names[b.server, b.command] for b in heard}
        unjudged = unjudged_contracts(compiled, tuple(topics))
        controller = Controller(compiled, heard, unjudged)
        comparison = ControllerComparison(compiled, topics, unjudged, tolerance)
        sinks = (*sinks, comparison)
    window = RecordingWindow(spec.length_ns, frame_ns=compiled.frame_ns, sinks=sinks)
    for sink in ui.sinks:
        window.record(sink)
    drivers = DriverWatch(robot_address, servers, ui.report)
    with closing(drivers), ui.interruptible() as interrupted:
        shadow = Shadow(compiled, bindings, deployed, (window,), controller)
        if spec.record is not None:
            live = LiveRun(deployed.run, shadow=True)
            recording = recording_into(
                spec.record,
                compiled,
                seed=spec.world.seed,
                robot=robot_address.robot,
                live=live,
                heard=tuple(topics),
            )
            window.record(recording)
        with _joined(robot_address, shadow, window, ui) as (host, failed):
            lag = LagReports(shadow, ui.report)
            _follow(host, robot_address, deployed, window, ui, _Stop(interrupted, recording), failed, lag)
    if recording is not None:
        recording.expect_frames()
    summary = tally.summary(
        seed=spec.world.seed, duration_s=window.shown_ns / 1e9, interrupted=interrupted(), travel=None
    )
    return RunReport(
        replace(
            summary,
            broke_off=None if recording is None else recording.truncation,
            driver_failures=drivers.failures,
            shadow=True,
        ),
        None,
        controller=None if comparison is None else comparison.report(),
    )


class _Stop:
    """The reasons to end a run early: it was interrupted, or its recording broke off."""

    def __init__(self, interrupted: Callable[[], bool], recording: RunRecording | None) -> None:
        self._interrupted, self._recording = interrupted, recording

    def __call__(self) -> bool:
        return self._interrupted() or (self._recording is not None and self._recording.truncation is not None)


class LagReports:
    """Reports, once each time, that the shadow is behind the robot, or stuck in a frame. Mutable."""

    def __init__(self, shadow: Shadow, report: Callable[[str], None]) -> None:
        self._shadow, self._report = shadow, report
        self._is_behind = False
        self._deciding: int | None = None
        self._since_s = 0.0

    def check(self, now_s: float) -> None:
        """Check how far it is behind, and how long a decision takes; `now_s` is by a monotonic clock."""
        behind_ns, deciding = self._shadow.behind_ns, self._shadow.deciding
        if deciding != self._deciding:
            self._deciding, self._since_s = deciding, now_s
        if deciding is not None:
            behind_ns = max(behind_ns, round((now_s - self._since_s) * 1e9))
        if behind_ns > BEHIND_NS and not self._is_behind:
            self._report(
                f"the shadow is {behind_ns / 1e9:.1f} s behind the robot: this computer, or a module in "
                "Python, is too slow; in a run clients would be late"
            )
        self._is_behind = behind_ns > (BEHIND_NS // 2 if self._is_behind else BEHIND_NS)


def _expect_accepted(robot_address: RobotAddress, deployed: Deployment) -> bool:
    """Check that the robot's Clock would accept the program; return True if it accepts none, read-only.

    Raises:
        LiveError, RobotConnectionError: the Clock does not answer.
        RunAbortedError: it would not.
    """
    reasons = list(problems(deployed))
    give_up_at_s = time.monotonic() + START_TIMEOUT_S
    while True:
        try:
            with session_with(robot_address) as session, session.connect(CLOCK) as connection:
                served = connection.do(clock.interface())
                is_read_only = connection.do(clock.participants()).read_only
            break
        except RobotConnectionError:  # the robot may just be starting
            if time.monotonic() > give_up_at_s:
                raise
    reasons += filter(None, [interface_problem(deployed.interface, served)])
    if reasons:
        raise RunAbortedError(f"{robot_address.robot} would refuse this program: {'; '.join(reasons)}")
    return is_read_only


@contextmanager
def _joined(
    robot_address: RobotAddress, shadow: Shadow, window: RecordingWindow, ui: UserInterface
) -> Iterator[tuple[Host, list[BaseException]]]:
    """Run the node in a thread inside the `with`; the list gets the exception that ended it."""
    with Host.open(robot_address, (shadow,), announces=False, report=ui.report) as host:

        def run() -> None:
            try:
                host.run()
            finally:
                window.shut()

        def stop() -> None:
            window.shut()
            host.stop()

        with in_thread("shadow", run, stop) as failed:
            yield host, failed
    if failed:
        raise failed[0]


def _follow(
    host: Host,
    robot_address: RobotAddress,
    deployed: Deployment,
    window: RecordingWindow,
    ui: UserInterface,
    stop: Callable[[], bool],
    failed: list[BaseException],
    lag: LagReports,
) -> None:
    """Wait until the window is over.

    Raises:
        RunAbortedError: no frame comes, or the robot's Clock stays absent.
    """
    watch = WindowWatch(robot_address.robot, window, ui.report)
    with ExitStack() as resources:
        host.network.watch(lambda address, present: watch.note(address, present, time.monotonic()))
        session = resources.enter_context(Session(Hub(host.network)))
        if deployed.reads:
            showing = RestartedScript(session, lambda: _showing(deployed.reads), name="shadow")
            resources.enter_context(closing(showing))
        give_up_at_s = time.monotonic() + START_TIMEOUT_S
        while not window.over and not stop() and not failed:
            failure = watch.check(time.monotonic())
            if failure is None and not window.begun and time.monotonic() > give_up_at_s:
                failure = f"no frame of {robot_address.robot} came in {START_TIMEOUT_S:g} s"
            if failure is not None:
                raise RunAbortedError(failure)
            lag.check(time.monotonic())
            window.changed.wait(HEALTH_CHECK_INTERVAL_S)
            if window.begun and not window.over:
                window.changed.clear()


def _showing(variables: tuple[str, ...]) -> Script:
    """Return a script that lets DServer's frames show variables, without setting them."""
    while True:
        yield from do(DSERVER.name, data.publish(variables))
        yield from sleep(REPEAT_INTERVAL_S)
