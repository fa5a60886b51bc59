"""The bridge between colony and ROS 2: one node, in a process of the robot's own ROS environment.

It needs the standard library and rclpy alone, and runs under any Python from 3.8 on. Colony starts it with
one end of a socket pair (SOCK_SEQPACKET) as the file descriptor `sys.argv[1]`. Messages cross as raw CDR, so
that neither side needs the other's packages.

The bridge is the last process above the base, and therefore the dead-man switch. A commanded topic without a
freshly decided command for its timeout gets its stop message ten times, 20 ms apart, and then nothing. The
same happens when colony ends for any reason. The thread of the pipe does this, publishes, and never waits for
a callback of ROS.

Packets to the bridge, by their first byte:
    c  settings in JSON: the first packet has the node; later ones add topics
    d  a decided command: channel, time of the decision (CLOCK_MONOTONIC in ns), payload
    s  a stop: channel, number. It is published at once, and answered
    p  a question whether the bridge is alive: number

Packets from the bridge:
    m  a message: channel, time of arrival (CLOCK_MONOTONIC in ns), ROS time then (ns), CDR
    a  the answer: number, then the reason why the stop was not published; empty if it was
    j  a report in JSON: the ends of its topics; in a survey, also those of each topic of the graph

The payload of a twist is its six doubles: the bridge makes the type of them that the subscribers expect.
"""

from __future__ import annotations

import errno
import importlib
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
from typing import Any

STOPS = 10
STOP_PAUSE_NS = 20_000_000
LOOK_S = 1.0
EARLY_LOOK_S = 0.1
EARLY_LOOKS = 30
SETTLED_NS = 1_000_000_000
FLUSH_S = 0.05
FAREWELL_S = 0.5
GHOST_NS = 30_000_000_000
MAX_LISTED = 50  # publishers or subscribers of a topic in a report, which has to fit into a packet
MAX_BYTES = 1 << 20
HISTORY_DEPTH = 100  # messages of one topic that several nodes keep, such as /tf_static

DECIDED = struct.Struct("<cHq")
STOP = struct.Struct("<cHI")
MESSAGE = struct.Struct("<cHqq")
ANSWER = struct.Struct("<cI")
CDR = b"\x00\x01\x00\x00"

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
TWISTS = (TWIST, TWIST_STAMPED)
BEST_EFFORT, LATCHED, HISTORY = "best_effort", "latched", "history"


def interface(name: str) -> Any:
    """Return the class of a message, such as `sensor_msgs/msg/LaserScan`."""
    package, kind, class_name = name.split("/")
    try:
        return getattr(importlib.import_module(package + "." + kind), class_name)
    except (ImportError, AttributeError):
        raise ValueError(f"this ROS environment has no type `{name}`") from None


def definitions(name: str, found: dict[str, Any]) -> dict[str, Any]:
    """Add the fields and types of a message, and of those that it is made of, to `found`."""
    if name not in found:
        fields = interface(name).get_fields_and_field_types()
        found[name] = list(fields.items())
        for kind in fields.values():
            kind = kind[len("sequence<") :].rstrip(">") if kind.startswith("sequence<") else kind
            kind = kind.split(",")[0].split("[")[0]
            if "/" in kind:
                package, class_name = kind.split("/")
                definitions(f"{package}/msg/{class_name}", found)
    return found


def profile(quality: str) -> Any:
    """Return the quality of service of a topic; its depth is 1 but for a history."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    best, latched = quality == BEST_EFFORT, quality in (LATCHED, HISTORY)
    return QoSProfile(
        depth=HISTORY_DEPTH if quality == HISTORY else 1,
        reliability=ReliabilityPolicy.BEST_EFFORT if best else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class OutputTopic:
    """A topic that colony commands.

    The thread of the pipe publishes; the executor's thread creates the publisher and replaces it.
    """

    def __init__(self, settings: dict[str, Any]) -> None:
        self.topic: str = settings["topic"]
        self.wanted: str = settings["type"]
        self.quality: str = settings.get("qos", "reliable")
        self.frame: str = settings.get("frame", "")
        self.is_alone: bool = settings.get("alone", False)
        self.timeout_ns = int(1e6 * settings["timeout_ms"])
        self.is_stopped: bool = settings["stop"]
        self.stop = b"\0" * 48
        self.node: Any = None
        self.active: tuple[Any, str] | None = None  # the publisher and its type
        self.error = f"{self.topic} is being discovered"
        self.decided_ns: int | None = None
        self.stops_left = 0
        self.next_stop_ns = 0
        self.older: set[bytes] = set()  # the publishers of this node's name that were there before its own

    # --- the executor's thread ----------------------------------------------------------------------

    def look(self, node: Any, age_ns: int) -> dict[str, Any]:
        """Create the publisher, or one of another type; return what the graph shows of the topic."""
        name = node.resolve_topic_name(self.topic)
        own = (node.get_name(), node.get_namespace())
        publishers = describe(self.others(node.get_publishers_info_by_topic(name), own, age_ns))
        subscribers = describe(node.get_subscriptions_info_by_topic(name))
        try:
            expected = [each[2] for each in subscribers]
            self.choose(node, name, publishers, expected, age_ns >= SETTLED_NS)
        except Exception as problem:
            self.error = f"{name}: {problem}"
        active = self.active
        return {
            "name": name,
            "type": active[1] if active else "",
            "publishers": publishers[:MAX_LISTED],
            "subscribers": subscribers[:MAX_LISTED],
            "error": self.error,
        }

    def others(self, infos: Iterable[Any], own: tuple[str, str], age_ns: int) -> list[Any]:
        """Return the publishers that are not this one, nor that of a bridge that was killed.

        The graph keeps the latter for a while. It has the name of this node, and was there before.
        """
        infos = list(infos)
        same = [gid_of(info) for info in infos if (info.node_name, info.node_namespace) == own]
        if self.active is None:
            self.older.update(same)
        ours = {gid for gid in same if gid in self.older and age_ns < GHOST_NS}
        ours.update([gid for gid in same if gid not in self.older][:1])
        return [info for info in infos if gid_of(info) not in ours]

    def choose(
        self, node: Any, name: str, publishers: list[Any], expected: list[str], is_settled: bool
    ) -> None:
        """Create the publisher once it may be, with the type that the subscribers expect."""
        kind = self.active[1] if self.active else None
        if kind is None and self.is_alone:
            if not is_settled:
                self.error = f"{name} is being discovered"
                return
            if publishers:
                self.error = f"{shown(publishers[0])} publishes {name} already"
                return
        wanted: str | None
        if self.wanted != "auto":
            wanted = self.wanted
        elif kind in expected:
            wanted = kind
        else:
            wanted = next((each for each in TWISTS if each in expected), kind)
        if wanted is None:
            self.error = f"no node subscribes to {name}"
            return
        if wanted != kind:
            if self.active is not None:  # a participant cannot have both types of a topic
                old, self.active = self.active[0], None
                node.destroy_publisher(old)
            class_ = interface(wanted)
            if wanted not in TWISTS:
                from rclpy.serialization import serialize_message

                self.stop = serialize_message(class_())
            publisher = node.create_publisher(class_, self.topic, profile(self.quality))
            self.node, self.active = node, (publisher, wanted)
        self.error = ""

    # --- the thread of the pipe ---------------------------------------------------------------------

    def publish(self, payload: bytes) -> str:
        """Publish a payload; return the reason why it was not, or an empty text."""
        active = self.active
        if active is None:
            return self.error or f"{self.topic} is being discovered"
        publisher, kind = active
        try:
            if kind == TWIST:
                payload = CDR + payload
            elif kind == TWIST_STAMPED:
                now = self.node.get_clock().now().nanoseconds
                frame = self.frame.encode() + b"\0"
                header = struct.pack("<iII", now // 10**9, now % 10**9, len(frame)) + frame
                payload = CDR + header + b"\0" * (-len(header) % 8) + payload
            publisher.publish(payload)
            heard = publisher.get_subscription_count()
        except Exception as problem:  # whatever rclpy and the middleware raise
            return f"{self.topic}: {problem}"
        return "" if heard else f"no node subscribes to {self.topic}"

    def decide(self, decided_ns: int, payload: bytes, now_ns: int) -> None:
        """Publish a decided command, unless it is older than the timeout."""
        if now_ns - decided_ns < self.timeout_ns:
            self.decided_ns, self.stops_left = decided_ns, 0
            self.publish(payload)

    def halt(self, now_ns: int) -> str:
        """Publish the stop, and plan its repetitions; return the reason why it was not published."""
        self.decided_ns = None
        if not self.is_stopped:
            return ""
        self.stops_left, self.next_stop_ns = STOPS - 1, now_ns + STOP_PAUSE_NS
        return self.publish(self.stop)

    def due_ns(self) -> int | None:
        """Return when `tick` has something to do; None if nothing is expected."""
        if self.stops_left:
            return self.next_stop_ns
        return None if self.decided_ns is None else self.decided_ns + self.timeout_ns

    def tick(self, now_ns: int) -> None:
        """Publish the stop that is due."""
        due = self.due_ns()
        if due is None or now_ns < due:
            return
        if self.stops_left:
            self.stops_left -= 1
            self.next_stop_ns = now_ns + STOP_PAUSE_NS
            self.publish(self.stop)
        else:
            self.halt(now_ns)


def gid_of(info: Any) -> bytes:
    """Return the identifier of an end of a topic."""
    return bytes(info.endpoint_gid)


def describe(infos: Iterable[Any]) -> list[list[Any]]:
    """Return node, namespace, type, and whether reliable and latched, of the ends of a topic."""
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    return [
        [
            info.node_name,
            info.node_namespace,
            info.topic_type,
            info.qos_profile.reliability != ReliabilityPolicy.BEST_EFFORT,
            info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
        ]
        for info in infos
    ]


def shown(end: list[Any]) -> str:
    """Return an end of a topic as messages show it: its node and its type."""
    namespace = end[1].rstrip("/")
    return f"`{namespace}/{end[0]}` ({end[2]})"


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
        self.outputs: list[OutputTopic] = []  # grows only
        self.added: list[dict[str, Any]] = []
        self.defined = 0
        self.lock = threading.Lock()
        self.began_ns = time.monotonic_ns()
        self.looks = 0
        self.news = self.node.create_guard_condition(self.listen_all)
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
            if output.wanted not in ("auto", *TWISTS):
                self.define(output.wanted)
        for settings in added:
            error = ""
            if settings["type"] == "auto":
                self.twists[len(self.inputs)] = ("", None)
                self.inputs.append((settings["topic"], error))
                continue
            try:
                kind = interface(settings["type"])
                self.define(settings["type"])
                callback = self.receiver(len(self.inputs))
                self.node.create_subscription(
                    kind, settings["topic"], callback, profile(settings.get("qos", BEST_EFFORT)), raw=True
                )
            except Exception as problem:
                error = str(problem)
            self.inputs.append((settings["topic"], error))
        self.look()

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

    def report(self, **what: Any) -> None:
        """Send a report."""
        with suppress(OSError):
            self.pipe.send(b"j" + json.dumps(what).encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)

    # --- the thread of the pipe ---------------------------------------------------------------------

    def add(self, settings: dict[str, Any]) -> None:
        """Add topics."""
        for each in settings.get("out", ()):
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
            self.answer(number, self.outputs[channel].halt(now_ns))
        elif kind == b"p":
            self.answer(ANSWER.unpack(packet)[1], "")
        elif kind == b"c":
            self.add(json.loads(packet[1:].decode()))
        return bool(packet)

    def answer(self, number: int, why: str) -> None:
        """Answer a stop or a question."""
        with suppress(OSError):
            self.pipe.send(ANSWER.pack(b"a", number) + why.encode(), socket.MSG_DONTWAIT)

    def finish(self) -> None:
        """Stop what was commanded, and end the process."""
        for output in self.outputs:
            if output.decided_ns is not None:
                output.halt(time.monotonic_ns())
        while any(output.stops_left for output in self.outputs):
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


if __name__ == "__main__":
    run(socket.socket(fileno=int(sys.argv[1])))
