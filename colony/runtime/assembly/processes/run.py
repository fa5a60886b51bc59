"""A run of a program by processes: the leader, and the processes that it starts and supervises.

The leader deploys the program, restarts processes that die, passes every frame to sinks, and answers queries
about the state of the run. When the run is over, or the leader is asked to stop, clients end first, then
servers, which stop the robot. If the leader is killed instead, all processes that it started end on their
own.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack

from colony.collector import gc_frozen
from colony.runtime.assembly.processes.children import (
    HEALTH_CHECK_INTERVAL_S,
    SHUTDOWN_GRACE_S,
    Children,
    Death,
    Job,
    RunFailedError,
    describe,
)
from colony.runtime.assembly.processes.hosting import HostedParts, leading
from colony.runtime.assembly.processes.run_status import LeaderServer, RunStatusTracker
from colony.runtime.assembly.processes.shutdown import reporting_stalls
from colony.runtime.assembly.processes.spec import ClientsPart, DriverFactory, SinglePart, name_of
from colony.runtime.assembly.processes.window import RecordingWindow, WindowWatch
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError, ServerNotFoundError
from colony.runtime.kit.hub import Hub
from colony.runtime.kit.script import Script
from colony.runtime.kit.script_live import RestartedScript
from colony.runtime.library.clock import deploy
from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Node
from colony.runtime.protocol.topics import client_address
from colony.runtime.transport.live.host import Host, Replacement
from colony.runtime.transport.live.robot_address import Local, RobotAddress

# --- deploying -----------------------------------------------------------------------------------------
#
# The leader's connections, which deploy the program to the Clock and to every participating server.
#
# A restarted server gets the program again. The run ends when these connections do. Each server has its own
# thread here, so that a missing server does not delay the others.


PAUSE_S = 0.05
"""Seconds between two attempts to reach a server."""

REFUSED_PAUSE_S = 0.5
"""Seconds between two attempts to deploy to a server that is in another run, whose leader may have died."""

BUSY_TIMEOUT_S = 3.0
"""Seconds that a server may be in another run before this run fails; longer than a lease."""


class ProgramDeployer:
    """Deploys a program to its servers. Stateful: knows which servers accepted it, and the first refusal.

    Args:
        session: session of this process with the robot; the deployer does not close it.
        deployment: program to run.
        servers: names of the servers.
        report: callback for a sentence about each server that it waits for; called from other threads.
    """

    def __init__(
        self, session: Session, deployment: Deployment, servers: Iterable[str], report: Callable[[str], None]
    ) -> None:
        self._session = session
        self._deployment = deployment
        self._report = report
        self._stop = threading.Event()
        self._accepting_servers: set[str] = set()
        self.refusal: str | None = None
        self._threads = [
            threading.Thread(
                target=self._keep_deployed, args=(server,), name=f"deploys to {server}", daemon=True
            )
            for server in servers
        ]
        for thread in self._threads:
            thread.start()

    @property
    def accepting_servers(self) -> frozenset[str]:
        """The servers that accepted the program."""
        return frozenset(self._accepting_servers)

    def close(self) -> None:
        """End the run. Idempotent."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    # --- one server ----------------------------------------------------------------------------------

    def _keep_deployed(self, server: str) -> None:
        with ExitStack() as resources:
            connection = self._connect(server)
            if connection is None:
                return
            resources.enter_context(connection)
            if self._deploy(server, connection):
                self._accepting_servers.add(server)
                self._stop.wait()

    def _connect(self, server: str) -> Connection | None:
        """Wait for the server, and return a connection; None if it refuses or the run ends."""
        name = f"run of {self._deployment.program}"
        reported = False
        while not self._stop.is_set():
            try:
                return self._session.connect(server, name=name)
            except ServerNotFoundError as problem:
                if not reported:
                    self._report(f"waiting: {problem}")
                    reported = True
            except CallRefusedError as problem:
                self._note_refusal(server, problem)
                return None
            except RobotConnectionError:
                pass
            self._stop.wait(PAUSE_S)
        return None

    def _deploy(self, server: str, connection: Connection) -> bool:
        """Deploy now and after every restart of the server; return True if it accepted the program."""
        waited_s = 0.0
        while not self._stop.is_set():
            try:
                connection.keep(deploy(self._deployment))
                return True
            except CallRefusedError as problem:
                if problem.code != "busy" or waited_s >= BUSY_TIMEOUT_S:
                    self._note_refusal(server, problem)
                    return False
                self._stop.wait(REFUSED_PAUSE_S)
                waited_s += REFUSED_PAUSE_S
            except RobotConnectionError:
                self._stop.wait(PAUSE_S)
        return False

    def _note_refusal(self, server: str, problem: CallRefusedError) -> None:
        self.refusal = self.refusal or f"{server}: {problem.message}"


# --- run -----------------------------------------------------------------------------------------------


START_TIMEOUT_S = 20.0
"""Timeout in seconds for a run to begin."""


class SupervisedRun:
    """A run whose leader, in this process, has joined the robot's processes. Mutable.

    Args:
        robot_address: address of the robot.
        deployment: program to run, as it is deployed.
        servers: servers to which it is deployed.
        observer: observer of the run, which passes frames to `window`.
        window: the part of the run to show.
        status_tracker: state of the run, for queries; one of the sinks of `window`.
        report: callback for a description of each event, of one line or several; called from any thread.
        on_end: called once all started processes have ended, and before another leader can start a run of the
            robot.

    Raises:
        AlreadyRunningError: this machine already leads a run of the robot.
        RunDirectoryError, UnreachableError: the robot's processes cannot be joined.
    """

    def __init__(
        self,
        robot_address: RobotAddress,
        deployment: Deployment,
        servers: Iterable[str],
        *,
        observer: Node,
        window: RecordingWindow,
        status_tracker: RunStatusTracker,
        report: Callable[[str], None],
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        self._robot_address = robot_address
        self._hosted: HostedParts | None = None
        self._given_up: str | None = None
        self._deployment = deployment
        self._servers = tuple(servers)
        self._window = window
        self._status_tracker = status_tracker
        self._report = report
        self._clock_watch = WindowWatch(robot_address.robot, window, report)
        self._scripts: dict[str, Callable[[], Script]] = {}
        self._failure: BaseException | None = None
        self._resources = ExitStack()
        with ExitStack() as resources:
            nodes = (LeaderServer(status_tracker), observer)
            host = resources.enter_context(
                Host.open(
                    robot_address,
                    nodes,
                    serves=isinstance(robot_address, Local),
                    report=report,
                    on_failure=self._replacement,
                )
            )
            self._hosted_resources = resources.enter_context(ExitStack())
            resources.callback(on_end)
            self._joined: set[str] = set()
            host.network.watch(self._note_presence)
            self._children = Children()
            status_tracker.set_pids(self._children.pids)
            resources.callback(self._end_children)
            self._host = host
            self._thread = threading.Thread(target=self._observe, name="observer", daemon=True)
            self._thread.start()
            resources.callback(self._end_observer)
            self._resources = resources.pop_all()

    def start(self, jobs: Iterable[Job]) -> None:
        """Start processes, and supervise them from now on.

        Raises:
            OSError: a process cannot be started.
        """
        for job in jobs:
            self._children.start(job)

    def host(self, parts: Sequence[SinglePart], devices: DriverFactory | None = None) -> None:
        """Run parts in this process from now on, with these drivers of simulated devices.

        Raises:
            AlreadyRunningError: another process runs one of the servers.
            Exception: see `parts.nodes_of`.
        """
        if not parts:
            return
        self._hosted = hosted = HostedParts(
            self._robot_address, devices, self._report, on_failure=self._note_failure
        )
        self._hosted_resources.callback(hosted.close)
        nodes = hosted.build(parts)
        self._host.network.claim(topics.servers(node.address for node in nodes))
        self._host.add(nodes)
        self._resources.enter_context(leading(self._host, parts, self._report))
        self._resources.enter_context(reporting_stalls(self._report))

    def play(self, name: str, script: Callable[[], Script]) -> None:
        """Run a script beside the run, from `follow` to its end; after a failed call, begin the next one."""
        self._scripts[name] = script

    def pid(self, name: str) -> int | None:
        """Return the id of a started process, None if it is not alive."""
        return self._children.pid(name)

    def wait_for(
        self, ready: Callable[[], bool], stop: Callable[[], bool], *, what: str, timeout_s: float
    ) -> bool:
        """Supervise the processes until `ready()` is true; return False if `stop` ended the wait first.

        Raises:
            RunFailedError: it takes longer than `timeout_s` (the message names `what`), or a process that the
                run needs died and is not restarted.
        """
        deadline = time.monotonic() + timeout_s
        while not ready():
            if stop():
                self._window.shut()
                return False
            if time.monotonic() > deadline:
                raise RunFailedError(f"{what} takes longer than {timeout_s:g} s")
            self._children.check(self._note_death, self._requires)
            self._window.changed.wait(HEALTH_CHECK_INTERVAL_S)
        return True

    def follow(self, stop: Callable[[], bool], *, meanwhile: Callable[[], object] = lambda: None) -> bool:
        """Lead the run until its window is over; return False if `stop` ended it.

        `meanwhile` is called repeatedly. While the robot's Clock is absent, the length of the window counts
        in the time of this machine.

        Raises:
            RunFailedError: the run cannot begin or continue; for example, the Clock stays absent.
            OSError: as raised by a sink, for example because a recording cannot be written.
        """
        self._resources.enter_context(gc_frozen())
        session = Session(Hub(self._host.network))
        self._resources.callback(session.close)
        for name, script in self._scripts.items():
            self._resources.callback(RestartedScript(session, script, name=name).close)
        deployer = ProgramDeployer(session, self._deployment, self._servers, self._report)
        self._resources.callback(deployer.close)
        begin_by = time.monotonic() + START_TIMEOUT_S
        while not self._window.over:
            if stop():
                self._window.shut()
                return False
            self._children.check(self._note_death, self._requires)
            self._check(deployer, late=time.monotonic() > begin_by)
            failure = self._clock_watch.check(time.monotonic())
            if failure is not None:
                raise RunFailedError(failure)
            meanwhile()
            self._window.changed.wait(HEALTH_CHECK_INTERVAL_S)
            if self._window.begun and not self._window.over:
                self._window.changed.clear()
        self._raise_failure()
        return True

    def close(self) -> None:
        """End the run: clients, servers and hardware, in this order, then the observer. Idempotent.

        Raises:
            Exception: as raised by a sink.
        """
        self._window.shut()
        self._resources.close()
        self._raise_failure()

    def __enter__(self) -> SupervisedRun:
        """Return the run."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End the run."""
        self.close()

    # --- internals -----------------------------------------------------------------------------------

    def _observe(self) -> None:
        """Run the observer, in its own thread."""
        try:
            self._host.run()
        except BaseException as failure:
            self._failure = failure
            self._window.shut()

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None and self._given_up is not None:
            raise RunFailedError(self._given_up) from failure
        if failure is not None:
            raise failure

    def _end_observer(self) -> None:
        self._host.stop()
        self._thread.join()

    def _end_children(self) -> None:
        killed = self._children.stop(SHUTDOWN_GRACE_S)
        if killed:
            self._report(f"killed, because they did not end in time: {', '.join(killed)}")

    def _note_death(self, death: Death) -> None:
        reason, restarted = death.tail[-1] if death.tail else death.cause, death.pause_s is not None
        self._status_tracker.record_death(death.job.clients, reason, restarted=restarted)
        self._report(describe(death))

    def _requires(self, job: Job) -> bool:
        """Return True if the run must end because this process died: it is essential, or it never joined.

        A process of a run that has not begun counts as not joined.
        """
        joined = self._window.begun and job.name in self._joined
        return job.essential or not joined

    def _replacement(self, address: str, problem: Exception) -> Replacement:
        """Return what takes the place of a hosted node; a failure of the observer ends the run."""
        if self._hosted is None or not self._hosted.has(address):
            raise problem
        return self._hosted.replacement(address, problem)

    def _note_failure(self, part: SinglePart, reason: str, restarted: bool) -> None:
        clients = part.clients if isinstance(part, ClientsPart) else ()
        addresses = tuple(client_address(*client) for client in clients)
        self._status_tracker.record_death(addresses, reason, restarted=restarted)
        if not restarted:
            self._given_up = f"{name_of(part)} failed, and is not restarted: {reason}"

    def _note_presence(self, address: str, present: bool) -> None:
        """Record the nodes that have joined the robot; called in a network thread."""
        self._joined.add(address)
        self._clock_watch.note(address, present, time.monotonic())

    def _check(self, deployer: ProgramDeployer, *, late: bool) -> None:
        if deployer.refusal is not None:
            raise RunFailedError(deployer.refusal)
        if late and not self._window.begun:
            missing = [s for s in self._servers if s not in deployer.accepting_servers]
            reason = f"{', '.join(missing)} did not answer" if missing else "no frame was decided"
            raise RunFailedError(f"the run has not begun after {START_TIMEOUT_S:g} s: {reason}")
