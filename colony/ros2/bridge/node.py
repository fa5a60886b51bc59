"""The bridge between colony and ROS 2: one node, in a process of the robot's own ROS environment.

It needs the standard library and rclpy alone, and runs under any Python from 3.8 on. Colony starts it with
one end of a socket pair (SOCK_SEQPACKET) as the file descriptor `sys.argv[1]`. Messages cross as raw CDR, so
that neither side needs the other's packages.

The bridge is the last process above the base, and therefore the dead-man switch. A commanded topic without a
freshly decided command for its timeout gets its stop message ten times, 20 ms apart, and then nothing; a goal
of an action is canceled. The same happens when colony ends for any reason. The thread of the pipe does this,
publishes, and never waits for a callback of ROS.

Packets to the bridge, by their first byte:
    c  settings in JSON: the first packet has the node; later ones add topics
    d  a decided command: channel, time of the decision (CLOCK_MONOTONIC in ns), payload
    s  a stop: channel, number. It is published at once, and answered
    p  a question whether the bridge is alive: number
    i  in JSON, for the rest of ROS: the state of the robot, or the answer to a call of a service

Packets from the bridge:
    m  a message: channel, time of arrival (CLOCK_MONOTONIC in ns), ROS time then (ns), CDR
    a  the answer: number, then the reason why the stop was not published; empty if it was
    j  a report in JSON: the ends of its topics; in a survey, also those of each topic of the graph

The payload of a twist is its six doubles: the bridge makes the type of them that the subscribers expect. The
payload of an action is the number of the goal, which is another one whenever the goal is, and its message.
"""

from __future__ import annotations

import errno
import json
import os
import select
import signal
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import Any

from colony.ros2.bridge.actions import OutputAction
from colony.ros2.bridge.introspection import Introspection
from colony.ros2.bridge.topics import (
    BEST_EFFORT,
    MAX_LISTED,
    SETTLED_NS,
    STOP_PAUSE_NS,
    TWISTS,
    OutputTopic,
    definitions,
    describe,
    interface,
    profile,
)

LOOK_S = 1.0
EARLY_LOOK_S = 0.1
EARLY_LOOKS = 30
CANCEL_S = 0.4  # for the goals of actions to be canceled at the end
FLUSH_S = 0.05
FAREWELL_S = 0.5
MAX_BYTES = 1 << 20

DECIDED = struct.Struct("<cHq")
STOP = struct.Struct("<cHI")
MESSAGE = struct.Struct("<cHqq")
ANSWER = struct.Struct("<cI")


class Bridge:
    """The node, the topics that it hears, and those that it commands."""

    def __init__(self, pipe: socket.socket, settings: dict[str, Any]) -> None:
        import rclpy
        from rclpy.parameter import Parameter
        from rclpy.signals import SignalHandlerOptions

        given = settings["node"]
        rclpy.init(args=[], domain_id=given.get("domain"), signal_handler_options=SignalHandlerOptions.NO)
        simulated = Parameter("use_sim_time", value=bool(given.get("use_sim_time")))
        self.surveys = bool(given.get("survey"))
        silent = {"enable_rosout": False, "start_parameter_services": False} if self.surveys else {}
        self.node = rclpy.create_node(
            given["name"], namespace=given.get("namespace") or None, parameter_overrides=[simulated], **silent
        )
        self.pipe = pipe
        self.inputs: list[tuple[str, str]] = []  # settings, and why there is no subscription
        self.twists: dict[int, tuple[str, Any]] = {}  # of inputs of either type of twist, what is heard
        self.outputs: list[OutputTopic | OutputAction] = []  # grows only
        self.added: list[dict[str, Any]] = []
        self.defined = 0
        self.lock = threading.Lock()
        self.began_ns = time.monotonic_ns()
        self.looks = 0
        self.news = self.node.create_guard_condition(self.listen_all)
        self.goals = self.node.create_guard_condition(self.step)
        self.introspection: Introspection | None = None
        if given.get("introspection"):
            self.introspection = Introspection(self.node, self.report)
        self.add(settings)
        self.node.create_timer(LOOK_S, self.look)
        self.early = self.node.create_timer(EARLY_LOOK_S, self.look_early)

    # --- the executor's thread ----------------------------------------------------------------------

    def spin(self) -> None:
        """Receive messages for ever."""
        from rclpy.executors import SingleThreadedExecutor

        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        executor.spin()

    def listen_all(self) -> None:
        """Subscribe to the topics that were added."""
        with self.lock:
            added, self.added = self.added, []
        for output in self.outputs[self.defined :]:
            self.defined += 1
            if isinstance(output, OutputAction):
                self.define(f"{output.wanted}_Goal")
            elif output.wanted not in ("auto", *TWISTS):
                self.define(output.wanted)
        for settings in added:
            error = ""
            if settings["type"] == "auto":
                self.twists[len(self.inputs)] = ("", None)
                self.inputs.append((settings["topic"], error))
                continue
            try:
                self.define(settings["type"])
                self.listen(settings, self.receiver(len(self.inputs)))
            except Exception as problem:
                error = str(problem)
            self.inputs.append((settings["topic"], error))
        self.look()

    def listen(self, settings: dict[str, Any], callback: Callable[[bytes], None]) -> None:
        """Subscribe to a topic, or to the feedback on an action that is commanded."""
        topic, kind = settings["topic"], interface(settings["type"])
        if "/action/" in settings["type"]:
            actions = (each for each in self.outputs if isinstance(each, OutputAction))
            next(action for action in actions if action.topic == topic).forward = callback
            return
        quality = profile(settings.get("qos", BEST_EFFORT))
        self.node.create_subscription(kind, topic, callback, quality, raw=True)

    def hear_twist(self, index: int, topic: str, types: Iterable[str]) -> str:
        """Subscribe to a twist of the type that is published, and return that type; "" until there is one."""
        current, subscription = self.twists[index]
        published = [each for each in TWISTS if each in types]
        if published and current not in published:
            if subscription is not None:
                self.node.destroy_subscription(subscription)
            current, callback = published[0], self.receiver(index)
            self.twists[index] = (
                current,
                self.node.create_subscription(
                    interface(current), topic, callback, profile(BEST_EFFORT), raw=True
                ),
            )
        return current

    def step(self) -> None:
        """Send and cancel the goals of actions."""
        for output in list(self.outputs):
            if isinstance(output, OutputAction):
                output.step()

    def report_goal(self, channel: int, number: int, state: str) -> None:
        """Report the state of the goal of an action."""
        self.report(goal=[channel, number, state])

    def define(self, name: str) -> None:
        """Report the definition of a type; that there is none is found where it is used."""
        with suppress(ValueError):
            self.report(definitions=definitions(name, {}))

    def receiver(self, channel: int) -> Callable[[bytes], None]:
        """Return the callback of a subscription."""
        pipe, clock = self.pipe, self.node.get_clock()

        def heard(data: bytes) -> None:
            now = time.monotonic_ns()
            packet = MESSAGE.pack(b"m", channel, now, clock.now().nanoseconds) + data
            try:
                pipe.send(packet, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
            except OSError as problem:  # colony does not read: the message is lost
                if problem.errno == errno.EMSGSIZE:
                    topic = self.inputs[channel][0]
                    error = (
                        f"{topic}: a message of {len(data)} bytes is larger than the pipe to colony carries"
                    )
                    self.inputs[channel] = (topic, error)

        return heard

    def look_early(self) -> None:
        """Look often while nodes find each other."""
        self.looks += 1
        if self.looks >= EARLY_LOOKS:
            self.early.cancel()
        self.look()

    def look(self) -> None:
        """Report what the graph shows of each topic."""
        node = self.node
        heard = []
        for index, (topic, error) in enumerate(self.inputs):
            name = node.resolve_topic_name(topic)
            publishers = describe(node.get_publishers_info_by_topic(name))
            found = {"name": name, "publishers": publishers[:MAX_LISTED], "error": error}
            if index in self.twists:
                try:
                    found["type"] = self.hear_twist(index, topic, [each[2] for each in publishers])
                except Exception as problem:
                    found.update(type="", error=str(problem))
            heard.append(found)
        now_ns = time.monotonic_ns()
        age_ns = now_ns - self.began_ns
        self.report(
            graph={"in": heard, "out": [output.look(node, age_ns) for output in list(self.outputs)]},
            settled=age_ns >= SETTLED_NS,
            t_ns=now_ns,
            ros_ns=node.get_clock().now().nanoseconds,
        )
        for name, types in node.get_topic_names_and_types() if self.surveys else ():
            publishers = describe(node.get_publishers_info_by_topic(name))
            subscribers = describe(node.get_subscriptions_info_by_topic(name))
            ends = {"publishers": publishers[:MAX_LISTED], "subscribers": subscribers[:MAX_LISTED]}
            self.report(topic={"name": name, "types": types, **ends})

    def report(self, **what: Any) -> bool:
        """Send a report; return False if colony takes none."""
        try:
            self.pipe.send(b"j" + json.dumps(what).encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except OSError:
            return False
        return True

    # --- the thread of the pipe ---------------------------------------------------------------------

    def add(self, settings: dict[str, Any]) -> None:
        """Add topics."""
        for each in settings.get("out", ()):
            if "/action/" in each["type"]:
                reporter = partial(self.report_goal, len(self.outputs))
                self.outputs.append(OutputAction(each, self.goals.trigger, reporter, self.answer))
            else:
                self.outputs.append(OutputTopic(each))
        with self.lock:
            self.added += settings.get("in", ())
        self.news.trigger()

    def watch(self, wake: int) -> None:
        """Take packets, and stop what no fresh command renews, until colony ends; then end the process."""
        poll = select.poll()
        poll.register(self.pipe, select.POLLIN)
        poll.register(wake, select.POLLIN)
        is_running = True
        try:
            while is_running:
                due = [each for each in (output.due_ns() for output in self.outputs) if each is not None]
                pause_ns = min(due) - time.monotonic_ns() if due else None
                ready = poll.poll(None if pause_ns is None else max(0, -(-pause_ns // 1_000_000)))
                is_running = all(which == self.pipe.fileno() and self.take() for which, _ in ready)
                self.tick()
        finally:
            self.finish()

    def tick(self) -> None:
        """Publish the stops that are due."""
        now_ns = time.monotonic_ns()
        for output in self.outputs:
            output.tick(now_ns)

    def take(self) -> bool:
        """Take a packet; return False at the end of the pipe."""
        try:
            packet = self.pipe.recv(MAX_BYTES)
        except OSError:
            return False
        kind, now_ns = packet[:1], time.monotonic_ns()
        if kind == b"d":
            _, channel, decided_ns = DECIDED.unpack_from(packet)
            self.outputs[channel].decide(decided_ns, packet[DECIDED.size :], now_ns)
        elif kind == b"s":
            _, channel, number = STOP.unpack(packet)
            output = self.outputs[channel]
            if isinstance(output, OutputAction):
                output.stop_number = number
            self.answer(number, output.halt(now_ns))
        elif kind == b"p":
            self.answer(ANSWER.unpack(packet)[1], "")
        elif kind == b"c":
            self.add(json.loads(packet[1:].decode()))
        elif kind == b"i" and self.introspection is not None:
            self.introspection.take(json.loads(packet[1:].decode()))
        return bool(packet)

    def answer(self, number: int, why: str = "") -> None:
        """Answer a stop or a question."""
        with suppress(OSError):
            self.pipe.send(ANSWER.pack(b"a", number) + why.encode(), socket.MSG_DONTWAIT)

    def finish(self) -> None:
        """Stop what was commanded, and end the process."""
        due_s = time.monotonic() + CANCEL_S
        for output in self.outputs:
            if output.decided_ns is not None:
                output.halt(time.monotonic_ns())
        while any(
            not output.is_quiet and (isinstance(output, OutputTopic) or time.monotonic() < due_s)
            for output in self.outputs
        ):
            time.sleep(STOP_PAUSE_NS / 4e9)
            self.tick()
        time.sleep(FLUSH_S)
        end = threading.Timer(FAREWELL_S, os._exit, (0,))
        end.daemon = True
        end.start()
        self.node.context.try_shutdown()  # other nodes hear that this one leaves
        os._exit(0)


def run(pipe: socket.socket) -> None:
    """Run the bridge over its end of the socket pair."""
    packet = pipe.recv(MAX_BYTES)
    if not packet:
        return
    wake, awake = os.pipe()
    os.set_blocking(awake, False)
    signal.set_wakeup_fd(awake)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)
    try:
        bridge = Bridge(pipe, json.loads(packet[1:].decode()))
    except Exception as problem:
        text = f"{type(problem).__name__}: {problem}"
        pipe.send(b"j" + json.dumps({"failed": text, "python": sys.executable}).encode())
        if isinstance(problem, ImportError):  # the report says it all
            return
        raise
    watch = threading.Thread(target=bridge.watch, args=(wake,), daemon=True)
    watch.start()
    try:
        bridge.spin()
    finally:
        os.write(awake, b"\0")
        watch.join()
