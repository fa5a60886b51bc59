"""What the graph of ROS 2 shows of the topics of a robot, and what is wrong with it. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from colony.ir.ros2_messages import is_action


class End(NamedTuple):
    """A publisher of a topic, or a subscriber: its node, its type, and its quality of service."""

    node: str
    namespace: str
    type: str
    is_reliable: bool
    is_latched: bool

    def __str__(self) -> str:
        """Return the name of the node."""
        return f"`{self.namespace.rstrip('/')}/{self.node}`"


def heard_problems(found: Mapping[str, Any], type_: str, quality: str) -> Iterator[str]:
    """Yield what is wrong with a topic that is heard.

    Args:
        found: what the bridge reports of it.
        type_: the type that is expected.
        quality: the quality of service of the subscription: `best_effort`, `reliable` or `latched`.
    """
    name, publishers = found["name"], ends_of(found["publishers"])
    if found["error"]:
        yield f"{name}: {found['error']}"
    elif not publishers and not is_action(type_):
        yield f"no node publishes {name}"
    for end in publishers:
        if end.type != type_:
            yield f"{end} publishes {name} as {end.type}; expected {type_}"
        elif quality != "best_effort" and not end.is_reliable:
            yield f'{end} publishes {name} as best effort, and `qos` is "{quality}": nothing arrives'
        elif quality == "latched" and not end.is_latched:
            yield f'{end} does not keep its messages of {name}, and `qos` is "latched": nothing arrives'


def sent_problems(found: Mapping[str, Any], quality: str) -> Iterator[str]:
    """Yield what is wrong with a topic that is commanded; arguments as above."""
    name, type_ = found["name"], found["type"]
    if found["error"]:
        yield found["error"]
        return
    for end in ends_of(found["publishers"]):
        yield f"{end} publishes {name} as well ({end.type})"
    subscribers = ends_of(found["subscribers"])
    if not subscribers:
        yield f"no node subscribes to {name}"
    for end in subscribers:
        if type_ and end.type != type_:
            yield f"{end} subscribes to {name} as {end.type}, and {type_} is sent"
        elif end.is_reliable and quality == "best_effort":
            yield f'{end} subscribes to {name} as reliable, and `qos` is "{quality}": nothing arrives'
        elif end.is_latched and quality != "latched":
            yield f'{end} expects {name} as latched, and `qos` is "{quality}": nothing arrives'


def ends_of(found: list[list[Any]]) -> list[End]:
    """Return the ends that a report has."""
    return [End(*end) for end in found]
