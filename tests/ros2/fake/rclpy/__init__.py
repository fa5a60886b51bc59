"""As much of rclpy as the bridge uses, over files: for tests without ROS 2.

The folder FAKE_RCLPY has `graph.json`, the ends of each topic; `inbox`, lines of JSON: messages that arrive,
or seconds for which a callback does not return (`hang`); and `log`, a line for each publication.
"""

from __future__ import annotations

import json
import os
import threading
import time
from pathlib import Path
from types import SimpleNamespace

FOLDER = Path(os.environ["FAKE_RCLPY"])


def init(args=None, domain_id=None, signal_handler_options=None) -> None:
    if (FOLDER / "broken").exists():
        raise RuntimeError("no middleware")


def create_node(name, namespace=None, parameter_overrides=(), **services):
    return Node(name, namespace or "/")


def graph(topic: str, side: str) -> list:
    ends = json.loads((FOLDER / "graph.json").read_text()).get(topic, {}).get(side, [])
    return [
        SimpleNamespace(
            node_name=node,
            node_namespace="/",
            topic_type=type_,
            endpoint_gid=[number, *map(ord, side)],
            qos_profile=SimpleNamespace(reliability="reliable", durability="volatile"),
        )
        for number, (node, type_) in enumerate(ends)
    ]


class Publisher:
    def __init__(self, topic: str, type_: str) -> None:
        self.topic, self.type = topic, type_

    def publish(self, data: bytes) -> None:
        with open(FOLDER / "log", "a") as log:
            log.write(json.dumps([time.monotonic_ns(), self.topic, self.type, bytes(data).hex()]) + "\n")

    def get_subscription_count(self) -> int:
        return len(graph(self.topic, "subscribers"))


class Node:
    def __init__(self, name: str, namespace: str) -> None:
        self.name, self.namespace = name, namespace
        self.timers: list = []
        self.wanted: dict = {}
        self.guards: list = []
        self.context = SimpleNamespace(try_shutdown=lambda: None)

    def get_name(self) -> str:
        return self.name

    def get_namespace(self) -> str:
        return self.namespace

    def resolve_topic_name(self, topic: str) -> str:
        return "/" + topic

    def get_publishers_info_by_topic(self, name: str) -> list:
        return graph(name, "publishers")

    def get_subscriptions_info_by_topic(self, name: str) -> list:
        return graph(name, "subscribers")

    def get_topic_names_and_types(self) -> list:
        found = json.loads((FOLDER / "graph.json").read_text())
        return [
            (topic, sorted({type_ for side in ends.values() for _, type_ in side}))
            for topic, ends in found.items()
        ]

    def create_publisher(self, class_, topic, qos):
        return Publisher("/" + topic, class_.NAME)

    def destroy_publisher(self, publisher) -> None:
        pass

    def create_subscription(self, class_, topic, callback, qos, raw=False) -> str:
        self.wanted[topic] = callback
        return topic

    def destroy_subscription(self, topic) -> None:
        del self.wanted[topic]

    def create_timer(self, period_s, callback):
        timer = SimpleNamespace(period=period_s, callback=callback, due=0.0, is_on=True)
        timer.cancel = lambda: setattr(timer, "is_on", False)
        self.timers.append(timer)
        return timer

    def create_guard_condition(self, callback):
        event = threading.Event()
        self.guards.append((event, callback))
        return SimpleNamespace(trigger=event.set)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=time.time_ns()))
