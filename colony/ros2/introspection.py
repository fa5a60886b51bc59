"""The robot as other nodes of ROS 2 see it: what the bridge publishes, and the answers to calls.

Two threads read the robot as `colony ps` and `colony watch` do, over sessions of their own; drivers do not
wait for them. One answers the services of the bridge. The other one sends it the winners whenever they
change, and everything once a second.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from queue import Full, Queue
from typing import Any, NamedTuple

from colony.runtime.kit.connection import Session
from colony.runtime.kit.discovery import session_with
from colony.runtime.kit.emergency import StopButton
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.listener import hosting_listener
from colony.runtime.kit.robot_state import READER, RobotState, ServerState, state_of
from colony.runtime.library import clock
from colony.runtime.library.clock import TunedParam
from colony.runtime.library.leader import RunStatus
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import UNHEARD, Effect, Message, QuietNode, Tick, Verdict
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.runtime.transport.live.run_directory import LiveError
from colony.text.wording import listed

REPORT_INTERVAL_S = 1.0
"""Seconds between two diagnostics."""

RETRY_S = 1.0
"""Seconds until a robot that cannot be reached is tried again."""

MAX_CALLS = 8
"""Maximum number of calls that wait for their answers."""

NAME = "ROS 2"
"""Name of the connections to the robot."""

OK, WARN, ERROR = 0, 1, 2
"""Levels of diagnostic_msgs/msg/DiagnosticStatus."""

Send = Callable[[Mapping[str, Any]], None]
"""A function that sends the bridge a packet; it never blocks, and drops what the bridge does not take."""


class Diagnosis(NamedTuple):
    """A status of /diagnostics."""

    level: int
    name: str
    message: str
    values: Mapping[str, str]


# --- diagnostics ----------------------------------------------------------------------------------


def diagnoses(state: RobotState) -> Iterator[Diagnosis]:
    """Yield the diagnoses of a robot: its servers, its run, and its emergency stop."""
    robot = state.robot
    yield from (_server(robot, server) for server in state.servers)
    yield _stop(state)
    if state.run is None:
        yield Diagnosis(OK, f"{robot}: run", "no program runs", {})
    else:
        yield _run(robot, state.run, _acting(state))


def _server(robot: str, server: ServerState) -> Diagnosis:
    problems = [*server.failing, *server.full]
    if server.problem is not None:
        problems.append(server.problem)
    level = OK if server.state == "up" and not problems else ERROR
    if level == OK and server.opening:
        level, problems = WARN, ["the device is being opened"]
    process = {} if server.process is None else {"process": str(server.process)}
    return Diagnosis(level, f"{robot}: {server.server}", "; ".join(problems) or server.state, process)


def _stop(state: RobotState) -> Diagnosis:
    known, name = state.participants, f"{state.robot}: emergency stop"
    if known is None:
        return Diagnosis(ERROR, name, "the Clock does not answer", {})
    if known.trouble is not None:
        return Diagnosis(ERROR, name, known.trouble, {})
    if known.stopped is not None:
        return Diagnosis(WARN, name, f"stopped by {known.stopped.by}", {})
    return Diagnosis(OK, name, "released", {})


def _acting(state: RobotState) -> dict[str, str]:
    """Return the client or connection that commands each actuator."""
    found = {a.name: a.acting for each in state.actuators.values() for a in each.actuators}
    if state.arbitration is not None:
        found |= {actuator.name: state.arbitration.acting for actuator in state.arbitration.actuators}
    return {name: acting or "nobody" for name, acting in found.items()}


def _run(robot: str, run: RunStatus, acting: Mapping[str, str]) -> Diagnosis:
    lost = [c.address for c in run.clients if c.standing == "lost"]
    late = [c.address for c in run.clients if c.standing == "late"]
    broken = [f"the contract `{name}` was broken in {count} frames" for name, count in run.broken.items()]
    errors = [*broken, *(f"{address} is lost" for address in lost)]
    if run.disagreements:
        errors.append(f"{run.disagreements} frames disagree with the program")
    warnings = [f"{address} is late" for address in late]
    warnings += [
        f"the assumption `{name}` was broken in {count} frames" for name, count in run.assumptions.items()
    ]
    warnings += [f"`{sensor}` has a value of the wrong type" for sensor in run.faults]
    values = {"run": run.run, "program": run.file, "params": run.params, "frame": str(run.k)}
    values |= {f"{name} is commanded by": by for name, by in acting.items()}
    values |= {f"{c.address} late, lost": f"{c.late}, {c.lost}" for c in run.clients if c.late or c.lost}
    level = ERROR if errors else WARN if warnings else OK
    return Diagnosis(level, f"{robot}: run", "; ".join([*errors, *warnings]) or run.still or "runs", values)


Param = tuple[str, str | float | bool, str]
"""A param of the program: its name, its value, and its meaning."""


def params_of(state: RobotState, tuned: Iterable[TunedParam] = ()) -> list[Param]:
    """Return the params of the run that its text does not fix: those that a site set, and tunable ones.

    Tunable params are numbers in their declared units. Of others, numbers without a unit and bools are values
    of ROS; the rest is text, as the language writes it.
    """
    run = state.run
    if run is None:
        return []
    found: dict[str, Param] = {n: (n, _param(text), f"set by {run.params}") for n, text in run.site.items()}
    for each in tuned:
        name, unit = each.tunable.name, each.tunable.unit
        found[name] = name, each.value, f"{unit}, tunable from {each.tunable.low:g} to {each.tunable.high:g}"
    return list(found.values())


def _param(text: str) -> str | float | bool:
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text


# --- winners --------------------------------------------------------------------------------------


class ActuatorWinner(NamedTuple):
    """The module or connection that commands an actuator; None if none does. `reason` is for people."""

    by: str | None
    reason: str


def winner_of(verdict: Verdict) -> ActuatorWinner:
    """Return the winner of a verdict."""
    if verdict.hold is not None:
        return ActuatorWinner(verdict.outside, "emergency stop" if verdict.hold == "stopped" else "locked")
    if verdict.outside is not None:
        return ActuatorWinner(verdict.outside, "a connection commands")
    if verdict.by is None:
        unheard = [f"{client} is {fate}" for client, fate in verdict.fates if fate in UNHEARD]
        return ActuatorWinner(None, listed(unheard, "and") if unheard else "no module is active")
    if verdict.fault is not None:
        return ActuatorWinner(verdict.by, f"idle: {verdict.fault}")
    below = [client for client, fate in verdict.fates if fate == "suppressed"]
    return ActuatorWinner(
        verdict.by, f"suppresses {listed(below, 'and')}" if below else "the only active module"
    )


class WinnerListener(QuietNode):
    """A node that hears verdicts. Mutable: has the winner of each actuator of the run.

    Args:
        changed: called when the winners of a frame differ from those before.
    """

    address = "ROS 2 winners"
    listens = (topics.TICKS, topics.VERDICTS)

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._run = ""
        self._winners: dict[str, ActuatorWinner] = {}

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Take a verdict, or a tick, with which another run may begin."""
        before = self._winners
        if isinstance(message, Tick) and message.run != self._run:
            self._run, self._winners = message.run, {}
        elif isinstance(message, Verdict):
            self._winners = {**before, message.actuator: winner_of(message)}
        if self._winners != before:
            self._changed()
        return ()

    @property
    def text(self) -> str:
        """The winners as JSON."""
        return json.dumps({name: winner._asdict() for name, winner in sorted(self._winners.items())})


# --- threads --------------------------------------------------------------------------------------


class RobotIntrospection:
    """The threads that read a robot for the bridge. Mutable.

    Args:
        robot_address: the robot.
        send: sends the bridge a packet.
    """

    def __init__(self, robot_address: RobotAddress, send: Send) -> None:
        self._robot_address, self._send = robot_address, send
        self._calls: Queue[tuple[int, str]] = Queue(MAX_CALLS)
        self._closed = threading.Event()
        self._wake = threading.Event()
        self._threads = [
            threading.Thread(target=self._keep, args=(target,), name=f"ros2 {name}", daemon=True)
            for name, target in (("services", self._serve), ("diagnostics", self._diagnose))
        ]

    def start(self) -> None:
        """Start the threads."""
        for thread in self._threads:
            thread.start()

    def on_call(self, number: int, service: str) -> None:
        """Take a call of a service, `stop` or `release`; never blocks."""
        try:
            self._calls.put_nowait((number, service))
        except Full:
            self._send({"answer": [number, False, f"{MAX_CALLS} calls wait already"]})

    def close(self) -> None:
        """End the threads, and wait for them a little."""
        self._closed.set()
        self._wake.set()
        self.on_call(0, "")
        for thread in self._threads:
            thread.join(0.2)

    def _keep(self, target: Callable[[Session], None]) -> None:
        """Run a function with a session, again after each failure."""
        while not self._closed.is_set():
            try:
                with session_with(self._robot_address) as session:
                    target(session)
            except (LiveError, RobotConnectionError, OSError) as problem:
                self._refuse_calls(str(problem))
                self._closed.wait(RETRY_S)

    def _refuse_calls(self, why: str) -> None:
        while not self._calls.empty():
            number, _ = self._calls.get_nowait()
            self._send({"answer": [number, False, why]})

    def _serve(self, session: Session) -> None:
        with StopButton(session, name=NAME) as button:
            while not self._closed.is_set():
                number, service = self._calls.get()
                if not self._closed.is_set():
                    try:
                        is_done, message = press(button) if service == "stop" else release(session)
                    except RobotConnectionError as problem:
                        is_done, message = False, str(problem)
                    self._send({"answer": [number, is_done, message]})

    def _diagnose(self, session: Session) -> None:
        listener, due_s = WinnerListener(self._wake.set), 0.0
        with hosting_listener(self._robot_address, listener):
            while not self._closed.is_set():
                self._wake.clear()
                packet: dict[str, Any] = {"winner": listener.text}
                if (now_s := time.monotonic()) >= due_s:
                    due_s = now_s + REPORT_INTERVAL_S
                    state = state_of(session, self._robot_address)
                    params = params_of(state, _tuned(session) if state.run is not None else ())
                    packet |= {"diagnostics": list(diagnoses(state)), "params": params}
                self._send(packet)
                self._wake.wait(max(0.0, due_s - time.monotonic()))


def _tuned(session: Session) -> tuple[TunedParam, ...]:
    with session.connect(CLOCK, name=READER) as connection:
        return connection.do(clock.tunables())


def press(button: StopButton) -> tuple[bool, str]:
    """Stop a robot; return whether the stop is kept, and a sentence."""
    pressed = button.insist(button.press())
    if pressed.kept:
        return True, f"stopped; acknowledged by {', '.join(pressed.acknowledged)}"
    return False, f"stop sent, but: {'; '.join(pressed.problems.values())}"


def release(session: Session) -> tuple[bool, str]:
    """Release the emergency stop of a robot; return whether it was, and a sentence."""
    with session.connect(CLOCK, name=NAME) as connection:
        if connection.do(clock.participants()).stopped is None:
            return False, "no emergency stop is in force"
        connection.do(clock.release())
    return True, "released"
