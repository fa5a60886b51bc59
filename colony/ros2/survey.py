"""A survey of a ROS 2 graph: its topics, their ends, and the messages of those that a robot may have.

Nothing is published, and no publisher of a command is made.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

from colony.ir.ros2_messages import STANDARD, STRING, TRANSFORMS
from colony.ros2.cdr import MessageError, Structure, decode
from colony.ros2.connection import BridgeError, NodeSettings, Ros2Connection
from colony.ros2.graph import End, ends_of
from colony.ros2.incoming import ArrivedMessage, Incoming, measured_ns
from colony.ros2.scan import UnusableError
from colony.ros2.topics import HeardTopic

NAME = "colony_survey"
"""Name of the node that looks."""

KEPT = 100
"""Number of messages of a topic that are kept."""

PATIENCE_S = 5.0
"""Seconds for which topics are waited for of which nothing came."""

LOOK_S = 0.05
"""Seconds between two checks for topics that are new."""

LATCHED_TOPICS = {"tf_static": TRANSFORMS, "robot_description": STRING}
"""The topics, by the last part of their names, whose messages are kept for late subscribers."""

_UNREAD = (TRANSFORMS, STRING, "std_msgs/msg/Empty", "std_msgs/msg/Header")
"""The standard types that are not read by themselves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyedTopic:
    """A topic of a graph.

    Attributes:
        name: its name, from the root.
        types: the types that its ends have.
        publishers, subscribers: its ends, but for the node that looked.
        messages: the values of those that arrived, at most `KEPT`; the newest is the last one.
        rate_hz: how many messages arrive in a second; None if fewer than two did.
        fault: why the newest message is no reading, such as a stamp in the future; None if it is.
    """

    name: str
    types: tuple[str, ...]
    publishers: tuple[End, ...] = ()
    subscribers: tuple[End, ...] = ()
    messages: tuple[Mapping[str, Any], ...] = ()
    rate_hz: float | None = None
    fault: str | None = None

    @property
    def newest(self) -> Mapping[str, Any] | None:
        """The newest message, or None."""
        return self.messages[-1] if self.messages else None


class GatheredMessages(Incoming):
    """The messages of a topic, which are kept. Mutable; `put` is called by another thread."""

    def __init__(self, topic: str, kind: Structure | None, frame: str = "") -> None:
        super().__init__(topic, kind, frame)
        self.arrived: list[ArrivedMessage] = []
        self.count = 0
        self.first_ns = 0

    def put(self, arrived: ArrivedMessage | None) -> None:
        """Keep a message."""
        super().put(arrived)
        if arrived is not None:
            self.first_ns = self.first_ns or arrived.t_ns
            self.count += 1
            self.arrived = [*self.arrived[1 - KEPT :], arrived]

    def read(self, topic: SurveyedTopic) -> SurveyedTopic:
        """Return a topic with what was heard of it."""
        arrived, kind = self.arrived, self.kind
        if not arrived or kind is None:
            return topic
        messages: list[Mapping[str, Any]] = []
        fault: str | None = None
        for each in arrived:
            try:
                messages.append(decode(kind, each.data))
                fault = None
                _expect_stamp(messages[-1], each)
            except (MessageError, UnusableError) as problem:
                fault = str(problem)
        lasted_s = (arrived[-1].t_ns - self.first_ns) / 1e9
        rate_hz = (self.count - 1) / lasted_s if lasted_s > 0.0 else None
        return replace(topic, messages=tuple(messages), rate_hz=rate_hz, fault=fault)


def _expect_stamp(message: Mapping[str, Any], arrived: ArrivedMessage) -> None:
    header = message.get("header")
    if isinstance(header, Mapping):
        measured_ns(arrived, header["stamp"]["sec"] * 1_000_000_000 + header["stamp"]["nanosec"])


def survey(node: NodeSettings, seconds: float) -> tuple[SurveyedTopic, ...]:
    """Return the topics of a graph, by name, with what arrives of them within some seconds.

    Args:
        node: the domain and namespace, and the Python with rclpy.
        seconds: how long to listen, from when the graph is known.

    Raises:
        BridgeError: no node can be made, with the reason.
    """
    heard: dict[str, tuple[HeardTopic, GatheredMessages]] = {}
    with closing(
        Ros2Connection.shared(replace(node, name=NAME, survey=True), lambda text: None)
    ) as connection:
        ends_s: float | None = None
        while ends_s is None or _is_waiting(ends_s, [gathered for _, gathered in heard.values()]):
            time.sleep(LOOK_S)
            if connection.problem is not None:
                raise BridgeError(connection.problem)
            if ends_s is None and not connection.is_opening:
                ends_s = time.monotonic() + seconds
            for name, topic in list(connection.topics.items()):
                if name not in heard and topic["publishers"] and (type_ := readable(name, topic["types"])):
                    quality = "history" if type_ in _UNREAD else "best_effort"
                    found = connection.hear(name, type_, quality=quality, incoming=GatheredMessages)
                    assert isinstance(found.incoming, GatheredMessages)
                    heard[name] = found, found.incoming
        topics = sorted(connection.topics.items())
    return tuple(_surveyed(name, topic, heard) for name, topic in topics)


def _is_waiting(ends_s: float, heard: Iterable[GatheredMessages]) -> bool:
    left_s = ends_s - time.monotonic()
    return left_s > 0.0 or (left_s > -PATIENCE_S and not all(each.count for each in heard))


def readable(name: str, types: Iterable[str]) -> str | None:
    """Return the type as which a topic is read; None if it is not read."""
    types = tuple(types)
    if len(types) != 1:
        return None
    expected = LATCHED_TOPICS.get(name.rpartition("/")[2])
    if expected is not None:
        return types[0] if types[0] == expected else None
    return types[0] if types[0] in STANDARD and types[0] not in _UNREAD else None


def _surveyed(
    name: str, topic: Mapping[str, Any], heard: Mapping[str, tuple[HeardTopic, GatheredMessages]]
) -> SurveyedTopic:
    found = SurveyedTopic(
        name=name,
        types=tuple(topic["types"]),
        publishers=tuple(end for end in ends_of(topic["publishers"]) if end.node != NAME),
        subscribers=tuple(end for end in ends_of(topic["subscribers"]) if end.node != NAME),
    )
    return heard[name][1].read(found) if name in heard else found
