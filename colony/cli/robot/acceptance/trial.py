"""An acceptance test of a robot: it is served, a behavior drives it, and a schedule of faults is executed.

The robot is served by a thread of this process; the run is a process of its own, so that its leader can be
frozen. The processes of servers and clients are those that the robot's run directory and its leader name.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import TypeVar

from colony.cli.interruption import in_thread
from colony.cli.robot.acceptance.findings import BACK_NS, AcceptanceFindings, FaultFinding, StopFinding
from colony.cli.robot.acceptance.hearing import (
    Speeds,
    VerdictListener,
    brakes_ns,
    disturbances,
    recovered_ns,
    slip,
    stopped_ns,
)
from colony.cli.serve.processes import SUPERVISOR, ServeSpec
from colony.cli.serve.serving import Report, serve_all
from colony.ir.servers import RSERVER
from colony.runs.spec import RunAbortedError
from colony.runtime.assembly.processes.children import last_lines
from colony.runtime.kit.connection import Session
from colony.runtime.kit.emergency import StopButton
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.hub import Hub
from colony.runtime.library import clock
from colony.runtime.library.leader import LEADER, run_status
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.configuration import LINK_LEASE_MS
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.network import local_time
from colony.runtime.transport.live.robot_address import Local
from colony.sim.plant.child import SIMULATOR, plant_socket
from colony.sim.plant.control import PlantControl

# --- the schedule ------------------------------------------------------------------------------------

# Emergency stops, deaths and freezes of processes come in turn. Each step waits until the robot has
# recovered from the step before, so that what was measured belongs to one step. The order does not depend
# on the speed of the machine: a seed gives one schedule, of any length.

FREEZE_S = (0.01, 0.6)
"""Shortest and longest freeze: from a fifth of a frame to more than twice the liveness lease."""

LEASE_FREEZES, LEASE_FREEZE_S = 0.2, (0.9 * LINK_LEASE_MS / 1000, 1.5 * LINK_LEASE_MS / 1000)
"""Part of the freezes that last about as long as the lease of a link, and their range."""

SPARED_FREEZE_S = (0.01, 0.2)
"""The range of all freezes with a process that may not die. The lease of a leader at the Clock is 525 ms."""

PAUSE_S = (0.0, 0.3)
"""Range of the pause before a step, so that it comes at any moment of a frame."""

HOLD_S = (0.2, 1.0)
"""Range of the time for which an emergency stop is held."""

DOUBLE_KILLS = 0.25
"""Part of the deaths at which a second process dies together with the first."""

DISTURBED_STOPS = 0.5
"""Part of the stops under which a process is killed or frozen."""

MOST_FROZEN = 3
"""Maximum number of processes that are frozen together."""


@dataclass(frozen=True, slots=True)
class ProcessFault:
    """SIGKILL to processes, or SIGSTOP for `freeze_s` seconds unless it is None."""

    processes: tuple[str, ...]
    freeze_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultStep:
    """An emergency stop for `hold_s` seconds, under which a fault may come, or a fault alone."""

    pause_s: float
    hold_s: float | None = None
    fault: ProcessFault | None = None


def steps(seed: int, mortal: Sequence[str], spared: Sequence[str] = ()) -> Iterator[FaultStep]:
    """Yield a stop, a death and a freeze, again and again; each process dies once in a round.

    Args:
        seed: seed of all that is drawn.
        mortal: names of the processes that are killed and frozen.
        spared: names of the processes that are only frozen.
    """
    random = Random(f"acceptance {seed}")
    while True:
        for name in random.sample(sorted(mortal), len(mortal)):
            under = None
            if random.random() < DISTURBED_STOPS:
                under = random.choice((_death(random, mortal, None), _freeze(random, mortal, spared)))
            yield FaultStep(pause_s=random.uniform(*PAUSE_S), hold_s=random.uniform(*HOLD_S), fault=under)
            for fault in (_death(random, mortal, name), _freeze(random, mortal, spared)):
                yield FaultStep(pause_s=random.uniform(*PAUSE_S), fault=fault)


def _death(random: Random, mortal: Sequence[str], name: str | None) -> ProcessFault:
    first = name or random.choice(sorted(mortal))
    others = [other for other in sorted(mortal) if other != first]
    second = (random.choice(others),) if others and random.random() < DOUBLE_KILLS else ()
    return ProcessFault((first, *second))


def _freeze(random: Random, mortal: Sequence[str], spared: Sequence[str]) -> ProcessFault:
    names = sorted((*mortal, *spared))
    frozen = tuple(random.sample(names, random.randint(1, min(MOST_FROZEN, len(names)))))
    shortest, longest = LEASE_FREEZE_S if random.random() < LEASE_FREEZES else FREEZE_S
    if not set(spared).isdisjoint(frozen):
        shortest, longest = SPARED_FREEZE_S
    return ProcessFault(frozen, math.exp(random.uniform(math.log(shortest), math.log(longest))))


# --- the trial ---------------------------------------------------------------------------------------


NAME = "colony robot test"
"""The name of the test's connections."""

POLL_S = 0.01
"""Seconds between two looks at what came."""

CENSUS_S = 1.0
"""Seconds between two measurements of the memory of the processes."""

READY_S = 300.0
"""Seconds in which every server and client has to be there, from the first frame of the run."""

LEADER_TIMEOUT_S = 1.0
"""Timeout in seconds of a call to the leader, which may be frozen or being started."""

JOINT = ", "
"""The separator between the names of servers that share a process."""

END_S = 30.0
"""Seconds in which the run has to end."""

T = TypeVar("T")


class InterruptedTestError(Exception):
    """The user ended the test."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AcceptanceRequest:
    """The request for a test.

    Attributes:
        served: the robot as it is served.
        arguments: those of `colony drive` with the behavior and the robot, without its recording.
        actuators: the actuators of the behavior.
        recording: the file of the recording.
        seed: the seed of the faults.
        seconds: the length of the test, from when the behavior drives.
        folder: the folder of logs.
    """

    served: ServeSpec
    arguments: tuple[str, ...]
    actuators: frozenset[str]
    recording: str
    seed: int
    seconds: float
    folder: Path


class RobotTrial:
    """A robot that is served and driven. Mutable.

    Args:
        robot_address: where it is served.
        request: the request.
        findings: what is found.
        interrupted: True once the user has ended the test.
        progress: function that is called with the seconds and what is done.
    """

    def __init__(
        self,
        robot_address: Local,
        request: AcceptanceRequest,
        findings: AcceptanceFindings,
        interrupted: Callable[[], bool],
        progress: Callable[[float, str], None],
    ) -> None:
        self._robot_address, self._request, self._findings = robot_address, request, findings
        self._interrupted, self._progress = interrupted, progress
        self._absent = frozenset(request.served.devices.absent)
        self._now = local_time(robot_address)
        self._checks: list[Callable[[], None]] = []
        self._listener = VerdictListener()
        self._session: Session | None = None
        self._started: Mapping[str, int] = {}
        self._led: frozenset[str] = frozenset()
        self._known: dict[str, int] = {}
        self._doing = ""
        self._began_s: float | None = None
        self._measured_s = 0.0
        self._plant: PlantControl | None = None
        self._speeds: deque[tuple[int, Speeds]] = deque(maxlen=5000)

    def run(self, report: Report) -> None:
        """Serve the robot, drive it, execute the schedule, and end everything.

        Raises:
            RunAbortedError: the robot cannot be served, or the run does not begin.
            InterruptedTestError: the user ended the test; what was found so far is in the findings.
        """
        with ExitStack() as resources:
            self._serve(resources, report)
            self._wait(lambda: {SUPERVISOR, CLOCK} <= self._running().keys() or None)
            self._checks.append(resources.enter_context(self._driven()))
            host = resources.enter_context(Host.open(self._robot_address, (self._listener,), announces=False))
            resources.enter_context(in_thread("listener", host.run, host.stop))
            self._session = session = resources.enter_context(Session(Hub(host.network)))
            self._wait_until_driven()
            self._open_plant(resources)
            self._known, self._led = self._processes(), frozenset(self._started)
            try:
                self._execute(session)
            except RunAbortedError as problem:
                self._findings.losses.append((self._now(), str(problem)))
            finally:
                self._findings.seconds = self._elapsed_s()

    # --- the beginning -------------------------------------------------------------------------------

    def _serve(self, resources: ExitStack, report: Report) -> None:
        """Serve the robot in a thread; what ends that too early is raised while the test waits."""
        ended = threading.Event()
        arguments = self._robot_address, self._request.served, report, nullcontext(ended.is_set)
        failed = resources.enter_context(in_thread("serving", lambda: serve_all(*arguments), ended.set))

        def check() -> None:
            if failed:
                raise failed[0]

        self._checks.append(check)

    @contextmanager
    def _driven(self) -> Iterator[Callable[[], None]]:
        """Run the behavior inside the `with`; the value is a function that checks that the run goes on."""
        folder, request = self._request.folder, self._request
        command = (sys.executable, "-m", "colony.cli.main", "drive", *request.arguments)
        with (folder / "run.out").open("wb") as out, (folder / "run.err").open("wb") as err:
            process = subprocess.Popen(
                [*command, "--record", request.recording, "--format", "json"],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                process_group=0,
            )

        def check() -> None:
            if (code := process.poll()) is not None:
                reason = "".join(f": {line}" for line in last_lines(folder / "run.err")[-1:])
                raise RunAbortedError(f"the run ended with exit code {code}{reason}")

        try:
            yield check
        finally:
            over = process.poll() is not None
            process.send_signal(signal.SIGINT)
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                self._findings.losses.append((None, f"the run did not end within {END_S:g} s of Ctrl-C"))
            if not over and self._began_s is not None:  # it has had a frame
                self._findings.disagreements = _disagreements(folder / "run.out")

    def _wait_until_driven(self) -> None:
        """Wait until every server and client has its part in the frames.

        Raises:
            RunAbortedError: one of them never has.
        """
        self._wait(lambda: any(frame.verdicts for frame in self._listener.since(0)) or None)
        if self._wait(self._recovery(self._now(), driven=True), READY_S) is None:
            raise RunAbortedError(f"the test cannot begin: {', '.join(self._missing())}")
        self._began_s = time.monotonic()

    def _open_plant(self, resources: ExitStack) -> None:
        """Connect to the simulator, which knows how fast the base is, if it simulates the base."""
        with suppress(OSError):
            if RSERVER.name in self._request.served.devices.hardware:
                return
            self._plant = PlantControl(plant_socket(self._robot_address.directory.path))
            resources.callback(self._plant.close)

    # --- the schedule --------------------------------------------------------------------------------

    def _execute(self, session: Session) -> None:
        """Execute steps for the length of the test, one of each kind at least."""
        mortal = [name for name in self._known if {LEADER, SIMULATOR}.isdisjoint(name.split(JOINT))]
        leaders = [name for name in self._known if LEADER in name.split(JOINT)]
        for number, step in enumerate(steps(self._request.seed, mortal, leaders)):
            if number >= 3 and self._elapsed_s() >= self._request.seconds:
                return
            self._wait(lambda: None, step.pause_s)
            if step.hold_s is not None:
                self._stop(session, step)
            elif step.fault is not None:
                self._strike(step.fault)

    def _stop(self, session: Session, step: FaultStep) -> None:
        """Stop the robot, hold it, with a fault meanwhile, and release it."""
        self._doing = "emergency stop"
        assert step.hold_s is not None
        with StopButton(session, name=NAME) as button:
            pressed_ns = self._now()
            pressed = button.press()

        def stopped() -> int | None:
            return stopped_ns(self._listener.since(pressed_ns - BACK_NS), self._request.actuators, pressed_ns)

        held_ns = self._wait(stopped, BACK_NS / 1e9)
        if step.fault is not None and held_ns is not None:
            self._strike(step.fault)
        self._wait(lambda: None, step.hold_s)
        self._doing = "release"
        frames, released_ns = self._listener.since(pressed_ns - BACK_NS), self._now()
        with suppress(RobotConnectionError), session.connect(CLOCK, name=NAME) as connection:
            connection.do(clock.release())
        resumed_ns = self._wait(self._recovery(released_ns, driven=True), BACK_NS / 1e9)
        finding = StopFinding(
            at_ns=pressed_ns,
            acknowledged=pressed.acknowledged,
            problems=tuple(pressed.problems.values()),
            stopped_ns=None if held_ns is None else held_ns - pressed_ns,
            slip=None if held_ns is None else slip(frames, held_ns),
            resumed_ns=None if resumed_ns is None else resumed_ns - released_ns,
        )
        self._findings.stops.append(finding)

    def _strike(self, fault: ProcessFault) -> None:
        """Kill or freeze processes, and wait until the robot has recovered."""
        self._note_losses(frozenset())
        pids = {name: self._known[name] for name in fault.processes if name in self._known}
        self._doing = f"{'kill' if fault.freeze_s is None else 'freeze'} {', '.join(pids)}"
        self._speeds.clear()
        self._measure()
        at_ns = self._now()
        if fault.freeze_s is None:
            _signal(pids, signal.SIGKILL)
            self._wait(lambda: not self._old(pids) or None, BACK_NS / 1e9)
            since_ns, missing = self._now(), self._old(pids)
        else:
            self._freeze(pids, fault.freeze_s)
            since_ns, missing = self._now(), ()
        back_ns = None if missing else self._wait(self._recovery(since_ns), BACK_NS / 1e9)
        finding = FaultFinding(
            kind="kill" if fault.freeze_s is None else "freeze",
            at_ns=at_ns,
            processes=tuple(pids),
            back_ns=None if back_ns is None else back_ns - (at_ns if fault.freeze_s is None else since_ns),
            missing=missing or (() if back_ns is not None else self._missing()),
            braked_ns=self._braked_ns(fault, at_ns),
        )
        self._findings.faults.append(finding)
        self._note_losses(pids.keys() if fault.freeze_s is None else frozenset())

    def _freeze(self, pids: Mapping[str, int], seconds: float) -> None:
        try:
            _signal(pids, signal.SIGSTOP)
            self._wait(lambda: None, seconds)
        finally:
            _signal(pids, signal.SIGCONT)

    def _braked_ns(self, fault: ProcessFault, at_ns: int) -> int | None:
        """Return for how long the moving base did not brake when its server, or the Clock, was killed."""
        names = {name for process in fault.processes for name in process.split(JOINT)}
        if fault.freeze_s is not None or self._plant is None or names.isdisjoint({RSERVER.name, CLOCK}):
            return None
        if not self._speeds or not any(self._speeds[0][1]):
            return None
        frames = self._listener.since(at_ns)
        commanded = [f.tick.t_ns for f in frames if any(v.by is not None for v in f.verdicts.values())]
        return brakes_ns(tuple(self._speeds), at_ns, min(commanded, default=self._now()))

    def _note_losses(self, killed: Set[str]) -> None:
        """Record the processes that died, or are missing, although nothing was done to them."""
        found = self._processes()
        for name, pid in self._known.items():
            if name not in killed and found.get(name) != pid:
                what = "is gone" if name not in found else "died by itself and was started again"
                self._findings.losses.append((self._now(), f"{name} {what}"))
        self._known = found

    # --- the robot -----------------------------------------------------------------------------------

    def _recovery(self, since_ns: int, *, driven: bool = False) -> Callable[[], int | None]:
        """Return a function that returns when the robot has recovered."""
        actuators, absent = self._request.actuators, self._absent
        return lambda: recovered_ns(self._listener.since(since_ns), actuators, absent, driven=driven)

    def _missing(self) -> tuple[str, ...]:
        """Return what is missing in the newest frame that is complete enough to tell."""
        frames = self._listener.since(0)[-2:]
        if not frames or frames[0].tick.t_ns < self._now() - BACK_NS:
            return ("no frame comes",)
        return tuple(disturbances(frames[0], self._request.actuators, self._absent))

    def _running(self) -> Mapping[str, int]:
        return self._robot_address.directory.running()

    def _processes(self) -> dict[str, int]:
        """Return the processes of servers, and those that the leader started, as it said last."""
        assert self._session is not None
        with (
            suppress(RobotConnectionError),
            self._session.connect(LEADER, name=NAME, timeout_s=LEADER_TIMEOUT_S) as leader,
        ):
            self._started = leader.do(run_status()).processes
        return self._served_processes() | dict(self._started)

    def _served_processes(self) -> dict[str, int]:
        """Return the processes of servers; the names of those that share one are joined."""
        names: dict[int, list[str]] = {}
        for name, pid in sorted(self._running().items()):
            if pid != os.getpid():
                names.setdefault(pid, []).append(name)
        return {JOINT.join(together): pid for pid, together in names.items()}

    def _old(self, pids: Mapping[str, int]) -> tuple[str, ...]:
        """Return what to report of the processes that have not been started again."""
        is_led = not self._led.isdisjoint(pids)  # the leader, which is slower, is asked only if it has to be
        found = self._processes() if is_led else self._served_processes()
        return tuple(f"{name} is not started" for name, pid in pids.items() if found.get(name, pid) == pid)

    def _elapsed_s(self) -> float:
        return 0.0 if self._began_s is None else time.monotonic() - self._began_s

    def _wait(self, condition: Callable[[], T | None], timeout_s: float | None = None) -> T | None:
        """Return what the condition gives as soon as that is something; None after the timeout.

        Raises:
            InterruptedTestError: the user ended the test.
            RunAbortedError: the robot, or the run, ended.
        """
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            if self._interrupted():
                raise InterruptedTestError
            for check in self._checks:
                check()
            self._listener.poll()
            self._measure()
            found = condition()
            now_s = time.monotonic()
            if found is not None or (deadline_s is not None and now_s >= deadline_s):
                return found
            time.sleep(POLL_S if deadline_s is None else min(POLL_S, deadline_s - now_s))

    def _measure(self) -> None:
        """Sample the speed of the base and, once a second, the memory of every process."""
        if self._plant is not None:
            try:
                truth = self._plant.truth(self._robot_address.robot)
            except OSError:
                self._plant = None
            else:
                t_ns = truth.t_ns - self._robot_address.directory.origin_ns()
                self._speeds.append((t_ns, (truth.velocity, truth.turn, truth.sideways)))
                self._findings.driven_mm = truth.distance
        elapsed_s = self._elapsed_s()
        if self._known and elapsed_s >= self._measured_s:
            self._measured_s = elapsed_s + CENSUS_S
            self._findings.memory.take({n: pid for n, pid in self._known.items() if n != SIMULATOR})
        if self._began_s is not None:
            self._progress(elapsed_s, self._doing)


def _signal(pids: Mapping[str, int], number: signal.Signals) -> None:
    for pid in pids.values():
        with suppress(ProcessLookupError):  # it just ended
            os.kill(pid, number)


def _disagreements(path: Path) -> tuple[str, ...]:
    try:
        return tuple(json.loads(path.read_bytes())["disagreements"])
    except (OSError, ValueError, KeyError):
        return ("the run printed no summary",)
