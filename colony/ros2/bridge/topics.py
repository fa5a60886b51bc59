"""The topics that the bridge commands, each with its dead-man switch, and what the graph shows of a topic."""

from __future__ import annotations

import importlib
import struct
from collections.abc import Iterable
from typing import Any

STOPS = 10
STOP_PAUSE_NS = 20_000_000
SETTLED_NS = 1_000_000_000
GHOST_NS = 30_000_000_000
HISTORY_DEPTH = 100  # messages of one topic that several nodes keep, such as /tf_static
MAX_LISTED = 50  # publishers or subscribers of a topic in a report, which has to fit into a packet

CDR = b"\x00\x01\x00\x00"

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
TWISTS = (TWIST, TWIST_STAMPED)
BEST_EFFORT, LATCHED, HISTORY = "best_effort", "latched", "history"


def interface(name: str) -> Any:
    """Return the class of a message, an action, or a part of one: `test_msgs/action/Fibonacci_Goal`."""
    package, kind, class_name = name.split("/")
    try:
        found = importlib.import_module(f"{package}.{kind}")
        for part in class_name.split("_"):
            found = getattr(found, part)
        return found
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

    @property
    def is_quiet(self) -> bool:
        """True if no stop is left to be published."""
        return not self.stops_left

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
