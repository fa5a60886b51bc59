"""The connection to ROS 2: a bridge process, which drivers share, and a thread that reads it."""

from __future__ import annotations

import json
import os
import select
import shlex
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from colony.backoff import Backoff
from colony.ir.ros2_messages import AUTO, STANDARD, TWIST
from colony.ros2.cdr import Definition, MessageError, structure
from colony.ros2.incoming import ArrivedMessage, Incoming, SimulatedClock
from colony.ros2.topics import CommandedAction, CommandedTopic, GoalState, HeardTopic
from colony.runtime.kit.once import OnceReporter, Report, exception_text, failure_text
from colony.runtime.transport.live.robot_address import RobotAddress

if TYPE_CHECKING:
    from colony.ros2.introspection import RobotIntrospection

BRIDGE = Path(__file__).with_name("bridge")

PYTHON = "/usr/bin/python3"
"""The Python of most ROS environments."""

START_S = 30.0
"""Seconds that a bridge may take to start, on a loaded machine."""

SILENT_S = 4.0
"""Seconds without a report, which comes each second, after which a bridge is ended that commands."""

QUIET_S = 0.5
"""Seconds without an answer of the thread that publishes after which it is asked whether it is alive."""

BUSY_S = 0.25
"""Seconds between two checks of what it has to answer, while messages keep coming."""

ANSWER_S = 0.5
"""Seconds that a bridge has to answer."""

ASK_AGAIN_S = 0.5
"""Seconds after which a stop that was not published is sent again."""

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 5.0
"""Seconds before a bridge is started again: after the first failure, and at most."""

STABLE_S = 5.0
"""Seconds that a bridge has to work before its next failure counts as a first one."""

WAKE_S = 0.05
"""Seconds between two checks of what is due."""

END_S = 1.0
"""Seconds that a bridge has to publish its last stops."""

MAX_PACKET_BYTES = 1 << 20

_LEFT_OUT = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
"""Variables of our environment that must not reach another one."""

_DECIDED = struct.Struct("<cHq")
_STOP = struct.Struct("<cHI")
_MESSAGE = struct.Struct("<cHqq")
_ANSWER = struct.Struct("<cI")


class BridgeError(Exception):
    """The bridge cannot run, or has ended."""


class FrozenError(BridgeError):
    """The bridge does not answer."""

    def __init__(self) -> None:
        super().__init__("the bridge did not answer, and was killed")


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeSettings:
    """The node of a robot.

    Attributes:
        name: its name.
        namespace: its namespace.
        domain: the domain; None for that of the environment.
        setup: the script that sets up the ROS environment; "" for none.
        python: the Python of that environment; "" for the usual one.
        use_sim_time: True if the time is that of the topic /clock.
        survey: True to hear of all topics of the graph.
        introspection: True if other nodes see the robot: its services, diagnostics, winners and params.
    """

    name: str = "colony"
    namespace: str = ""
    domain: int | None = None
    setup: str = ""
    python: str = ""
    use_sim_time: bool = False
    survey: bool = False
    introspection: bool = True

    def command(self, descriptor: int) -> list[str]:
        """Return the command that starts the bridge over its end of the socket pair."""
        if not self.setup:
            return [self.python or PYTHON, str(BRIDGE), str(descriptor)]
        python, bridge = shlex.quote(self.python or "python3"), shlex.quote(str(BRIDGE))
        return ["bash", "-c", f"source {shlex.quote(self.setup)} && exec {python} {bridge} {descriptor}"]

    def environment(self, given: Mapping[str, str]) -> dict[str, str]:
        """Return the environment of the bridge; without settings, that of colony is one of ROS."""
        is_other = self.setup or self.python or _LEFT_OUT[1] in given
        return {k: v for k, v in given.items() if not (is_other and k in _LEFT_OUT)}


_connections: dict[tuple[NodeSettings, Callable[[str], None]], Ros2Connection] = {}
"""The connections of this process, by node."""

_connections_lock = threading.Lock()


def to_stderr(problem: str) -> None:
    """Write a problem into the log of the server."""
    print(problem, file=sys.stderr, flush=True)


class Ros2Connection:
    """A bridge, and its topics. Mutable; shared by its thread and those of servers."""

    def __init__(self, node: NodeSettings, report: Report, robot: RobotAddress | None = None) -> None:
        self._node, self._report = node, report
        self._introspection: RobotIntrospection | None = None
        if robot is not None and node.introspection:
            from colony.ros2.introspection import RobotIntrospection

            self._introspection = RobotIntrospection(robot, self._send_state)
        self._inputs: list[HeardTopic] = []  # both grow only
        self._outputs: list[CommandedTopic] = []
        self._sent = (0, 0)  # the number of each that the bridge knows
        self._definitions: dict[str, Definition] = dict(STANDARD)
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._numbers = 0
        self._heard_s = self._life_s = self._pinged_s = 0.0
        self._is_up = self._is_settled = False
        self._clock = SimulatedClock()
        self.topics: dict[str, Mapping[str, Any]] = {}
        """What a survey has found of each topic: its `types`, `publishers` and `subscribers`."""
        self._problem: str | None = None
        self._problems: OnceReporter | None = None
        self._closed = threading.Event()
        self._drivers = 0
        self._thread = threading.Thread(target=self._run, name="ros2", daemon=True)

    @classmethod
    def shared(
        cls, node: NodeSettings, report: Report = to_stderr, robot: RobotAddress | None = None
    ) -> Ros2Connection:
        """Return the connection of this process for a node; each call is ended by `close`.

        Args:
            node: the node.
            report: takes each problem of the bridge.
            robot: the robot that other nodes see; None for none.
        """
        with _connections_lock:
            if (found := _connections.get((node, report))) is None:
                found = _connections[node, report] = cls(node, report, robot)
                found._thread.start()
                if found._introspection is not None:
                    found._introspection.start()
            found._drivers += 1
            return found

    # --- called by drivers ---------------------------------------------------------------------------

    def hear(
        self,
        topic: str,
        type_: str,
        *,
        quality: str = "best_effort",
        frame: str = "",
        incoming: type[Incoming] = Incoming,
    ) -> HeardTopic:
        """Subscribe to a topic, whose messages an `incoming` takes."""
        found = HeardTopic(incoming(topic, self.structure(type_), frame), type_, quality)
        with self._lock:
            self._inputs.append(found)
        return found

    def command(self, output: CommandedTopic) -> CommandedTopic:
        """Command a topic, and return it."""
        with self._lock:
            self._outputs.append(output)
        return output

    def structure(self, type_: str) -> Any:
        """Return the structure of a message; None while its definition is not known."""
        try:
            return structure(type_, self._definitions)
        except MessageError:
            return None

    @property
    def problem(self) -> str | None:
        """Why the bridge does not run, or time does not; None if both do."""
        if self._problem is not None:
            return self._problem
        return "/clock stands still" if self.is_paused else None

    @property
    def is_paused(self) -> bool:
        """True if the clock of the simulation stands still."""
        return self._node.use_sim_time and self._clock.is_paused

    def now_ns(self) -> int:
        """Return the time by the clock of arrivals."""
        return time.monotonic_ns()

    @property
    def is_opening(self) -> bool:
        """True until the bridge knows the graph, unless something failed."""
        return self._problem is None and not self._is_settled

    def decide(self, output: CommandedTopic, payload: bytes) -> None:
        """Publish a command that was decided in this frame.

        Raises:
            ConnectionError: the bridge does not run, or cannot publish.
        """
        connection = self._socket
        if connection is None or self._outputs.index(output) >= self._sent[1] or output.refusal:
            why = self._problem or output.error or "the bridge is starting"
            raise ConnectionError(f"{output.topic} is not commanded: {why}")
        with self._lock:
            self._numbers += 1
            output.number, output.unreached, output.asked_s = self._numbers, None, None
        packet = _DECIDED.pack(b"d", self._outputs.index(output), time.monotonic_ns()) + payload
        try:
            connection.send(packet, socket.MSG_DONTWAIT)
        except OSError as problem:
            raise ConnectionError(f"{output.topic} is not commanded: {problem}") from None

    def stop(self, output: CommandedTopic) -> None:
        """Have the stop published; `unreached` of the output says what has become of it. Never raises."""
        with self._lock:
            self._numbers += 1
            output.number = self._numbers
            output.unreached = f"{output.topic}: the bridge has not published it"
        self._ask(output)

    def unreached(self, output: CommandedTopic) -> str | None:
        """Return why the last stop was not published, or not yet; None if it was."""
        why = output.unreached
        return why if why is None else self._problem or why

    def close(self) -> None:
        """End the connection with its last driver: the bridge stops what was commanded."""
        with _connections_lock:
            self._drivers -= 1
            if self._drivers > 0:
                return
            for key in [key for key, found in _connections.items() if found is self]:
                del _connections[key]
        self._closed.set()
        if self._introspection is not None:
            self._introspection.close()
        self._thread.join(2 * END_S)

    # --- stops ---------------------------------------------------------------------------------------

    def _ask(self, output: CommandedTopic) -> None:
        """Send the stop of an output, if the bridge knows it."""
        connection, channel = self._socket, self._outputs.index(output)
        if connection is None or not self._is_up or channel >= self._sent[1]:
            return
        output.asked_s = time.monotonic()
        with suppress(OSError):  # the thread finds the bridge gone, or its silence
            connection.send(_STOP.pack(b"s", channel, output.number), socket.MSG_DONTWAIT)

    def _ask_again(self, now_s: float) -> None:
        """Send stops again that were not published.

        Raises:
            BridgeError: the bridge does not answer.
        """
        for output in self._outputs:
            if output.unreached is None:
                continue
            if output.asked_s is None and now_s >= output.retry_s:
                self._ask(output)
            elif output.asked_s is not None and now_s - output.asked_s > ANSWER_S:
                raise FrozenError

    def _answered(self, number: int, why: str) -> None:
        with self._lock:
            for output in self._outputs:
                if output.number == number:
                    output.unreached = f"{output.topic}: {why}" if why else None
                    output.asked_s, output.retry_s = None, time.monotonic() + ASK_AGAIN_S

    # --- the thread ----------------------------------------------------------------------------------

    def _run(self) -> None:
        backoff = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        while not self._closed.is_set():
            began_s = time.monotonic()
            try:
                self._serve()
            except Exception as problem:
                self._lose(problem)
            if time.monotonic() - began_s >= STABLE_S:
                backoff.reset()
            self._closed.wait(backoff.next())

    def _serve(self) -> None:
        """Start a bridge and take what it sends, until it ends, which raises, or the connection is closed."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with ours:
            try:
                bridge = self._start(theirs)
            finally:
                theirs.close()
            try:
                self._talk(ours, bridge)
            except FrozenError:
                bridge.kill()
                raise
            finally:
                self._forget()
                ours.close()
                _end(bridge)

    def _start(self, theirs: socket.socket) -> subprocess.Popen[bytes]:
        if (setup := self._node.setup) and not os.path.isfile(setup):
            raise BridgeError(f"there is no script {setup}")
        command = self._node.command(theirs.fileno())
        try:
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env=self._node.environment(os.environ),
                start_new_session=True,
            )
        except OSError as problem:
            raise BridgeError(f"{command[0]} cannot be started: {problem.strerror}") from None

    def _talk(self, ours: socket.socket, bridge: subprocess.Popen[bytes]) -> None:
        node = self._node
        first: dict[str, Any] = {"name": node.name, "namespace": node.namespace, "survey": node.survey}
        first["use_sim_time"] = node.use_sim_time
        self._sent = (0, 0)
        first |= {"domain": node.domain, "introspection": self._introspection is not None}
        self._send_settings(ours, {"node": first})
        self._socket, self._heard_s = ours, time.monotonic() + START_S - SILENT_S
        readable = select.poll()
        readable.register(ours, select.POLLIN)
        self._life_s = looped_s = read_s = time.monotonic()
        while not self._closed.is_set():
            is_ready = readable.poll(WAKE_S * 1000)
            if is_ready:
                self._take(received(ours), bridge)
            now_s = time.monotonic()
            if now_s - looped_s > ANSWER_S or not self._is_up:  # this process was frozen: its mail is old
                self._life_s = read_s = now_s
            looped_s = now_s
            self._check_life(ours, now_s)
            if self._sent != (len(self._inputs), len(self._outputs)):
                self._send_settings(ours, {})
            if not is_ready or now_s - read_s > BUSY_S:  # what it had answered by then is read
                read_s = now_s
                self._ask_again(now_s)
            if now_s - self._heard_s > (START_S if self._node.survey else SILENT_S):
                raise BridgeError("the bridge was silent, and was ended")

    def _check_life(self, ours: socket.socket, now_s: float) -> None:
        """Ask whether the thread that publishes is alive: messages come from another thread.

        Raises:
            FrozenError: it does not answer.
        """
        if self._pinged_s > self._life_s:
            if now_s - self._pinged_s > ANSWER_S:
                raise FrozenError
        elif now_s - self._life_s > QUIET_S:
            ours.send(_ANSWER.pack(b"p", 0), socket.MSG_DONTWAIT)
            self._pinged_s = now_s

    def _send_settings(self, ours: socket.socket, settings: dict[str, Any]) -> None:
        """Send settings with the topics that the bridge does not know."""
        with self._lock:
            inputs, outputs = self._inputs[self._sent[0] :], self._outputs[self._sent[1] :]
            settings["in"] = [each.settings() for each in inputs]
            settings["out"] = [each.settings() for each in outputs]
            ours.send(b"c" + json.dumps(settings).encode())
            self._sent = (len(self._inputs), len(self._outputs))

    def _send_state(self, state: Mapping[str, Any]) -> None:
        """Send the bridge what other nodes of ROS 2 see; what it does not take is dropped."""
        connection = self._socket
        if connection is not None and self._is_up:
            with suppress(OSError):
                connection.send(b"i" + json.dumps(state).encode(), socket.MSG_DONTWAIT)

    def _take(self, packet: bytes, bridge: subprocess.Popen[bytes]) -> None:
        kind = packet[:1]
        if kind == b"m":
            _, channel, t_ns, ros_ns = _MESSAGE.unpack_from(packet)
            self._clock.note(t_ns, ros_ns)
            self._inputs[channel].incoming.put(ArrivedMessage(t_ns, ros_ns, packet[_MESSAGE.size :]))
        elif kind == b"a":
            self._life_s = time.monotonic()
            self._answered(_ANSWER.unpack_from(packet)[1], packet[_ANSWER.size :].decode(errors="replace"))
        elif kind == b"j":
            self._take_report(json.loads(packet[1:]))
        else:
            code = bridge.wait(END_S)
            raise BridgeError(f"the bridge has ended with the exit code {code}: its output is in this log")

    def _take_report(self, report: Mapping[str, Any]) -> None:
        if "failed" in report:
            raise BridgeError(f"{report['python']}: {report['failed']}")
        if "definitions" in report:
            found = {
                name: [(field, kind) for field, kind in of] for name, of in report["definitions"].items()
            }
            self._definitions |= found
            for each in self._inputs:
                if each.type in found:
                    each.incoming.kind = self.structure(each.type)
        if "topic" in report:
            self.topics[report["topic"]["name"]] = report["topic"]
        if "goal" in report:
            channel, *goal = report["goal"]
            output = self._outputs[channel]
            assert isinstance(output, CommandedAction)
            output.note(GoalState(*goal))
        if "call" in report and self._introspection is not None:
            self._introspection.on_call(*report["call"])
        if "graph" in report:
            self._heard_s = time.monotonic()
            self._clock.note(report["t_ns"], report["ros_ns"])
            self._is_up, self._is_settled = True, report["settled"]
            self._take_graph(report["graph"])
            self._note_success()

    def _take_graph(self, graph: Mapping[str, Any]) -> None:
        for each, seen in zip(self._inputs, graph["in"], strict=False):
            if each.type == AUTO:
                each.incoming.kind = self.structure(seen["type"] or TWIST)
            each.take(seen, is_settled=self._is_settled)
        for output, seen in zip(self._outputs, graph["out"], strict=False):
            output.take(seen, is_settled=self._is_settled)

    def _forget(self) -> None:
        """Forget what a bridge that ends has heard; another one is asked for all stops again."""
        self._socket, self._is_up, self._is_settled = None, False, False
        self._clock = SimulatedClock()
        for each in self._inputs:
            each.incoming.put(None)
            each.problems = ()
        for output in self._outputs:
            output.forget()

    def _note_success(self) -> None:
        self._problem = None
        if self._problems is not None:
            self._problems = None
            self._report("the bridge to ROS 2 works again")

    def _lose(self, problem: Exception) -> None:
        """Report why the bridge has ended, once in an outage."""
        if self._closed.is_set():
            return
        is_known = isinstance(problem, BridgeError)
        text = exception_text(problem)
        self._problem = text if is_known else f"{type(problem).__name__}: {text}"
        self._problems = self._problems or OnceReporter(self._report)
        full = text if is_known else failure_text("the connection to ROS 2", problem)
        self._problems.report("", text if is_known else type(problem).__name__, full)


def received(ours: socket.socket) -> bytes:
    """Return the next packet; an empty one at the end.

    If the bridge left packets unread, an error comes once, before what it had sent.
    """
    with suppress(ConnectionResetError):
        return ours.recv(MAX_PACKET_BYTES)
    return ours.recv(MAX_PACKET_BYTES)


def _end(bridge: subprocess.Popen[bytes]) -> None:
    """End a bridge that has lost its connection: it publishes its last stops, unless it is frozen."""
    with suppress(subprocess.TimeoutExpired):
        bridge.wait(END_S)
    bridge.kill()
    bridge.wait()
