"""A commanded topic of the bridge, at given times: when it publishes, and what."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from colony.ros2.bridge.topics import GHOST_NS, SETTLED_NS, STOP_PAUSE_NS, OutputTopic

TWIST = "geometry_msgs/msg/Twist"
AHEAD = b"a" * 48
TIMEOUT_NS = 250_000_000


class Publisher:
    """A publisher. Mutable: what was published, and how many hear it."""

    def __init__(self) -> None:
        self.published: list[bytes] = []
        self.hearers = 1

    def publish(self, data: bytes) -> None:
        self.published.append(data[4:])

    def get_subscription_count(self) -> int:
        return self.hearers


def output(**settings: Any) -> tuple[OutputTopic, Publisher]:
    """Return an output with its publisher."""
    given = {"topic": "cmd_vel", "type": "auto", "stop": True, "timeout_ms": TIMEOUT_NS / 1e6}
    found, publisher = OutputTopic({**given, **settings}), Publisher()
    found.active = publisher, TWIST
    return found, publisher


def run(found: OutputTopic, until_ns: int) -> None:
    """Tick whenever something is due, up to a time."""
    while (due := found.due_ns()) is not None and due <= until_ns:
        found.tick(due)


@pytest.mark.parametrize(("age_ns", "is_published"), [(0, True), (TIMEOUT_NS - 1, True), (TIMEOUT_NS, False)])
def test_a_decision_as_old_as_the_timeout_is_dropped(age_ns: int, is_published: bool) -> None:
    found, publisher = output()
    found.decide(1000, AHEAD, 1000 + age_ns)
    assert publisher.published == [AHEAD] * is_published
    assert (found.due_ns() is None) == (not is_published)


def test_the_timeout_counts_from_the_newest_decision_and_is_followed_by_ten_stops() -> None:
    found, publisher = output()
    found.decide(0, AHEAD, 0)
    found.decide(100, AHEAD, 200)
    run(found, TIMEOUT_NS + 99)
    assert publisher.published == [AHEAD] * 2
    run(found, TIMEOUT_NS + 100)
    assert publisher.published == [AHEAD] * 2 + [bytes(48)]
    run(found, TIMEOUT_NS + 100 + 9 * STOP_PAUSE_NS)
    assert publisher.published == [AHEAD] * 2 + [bytes(48)] * 10
    assert found.due_ns() is None


def test_a_decision_ends_the_stops() -> None:
    found, publisher = output()
    assert found.halt(0) == ""
    found.decide(1, AHEAD, 1)
    assert publisher.published == [bytes(48), AHEAD]
    assert found.due_ns() == 1 + TIMEOUT_NS


def test_what_has_no_stop_falls_silent() -> None:
    found, publisher = output(stop=False)
    found.decide(0, AHEAD, 0)
    run(found, 10 * TIMEOUT_NS)
    assert publisher.published == [AHEAD]
    assert found.due_ns() is None


def test_a_stop_says_why_it_does_not_arrive() -> None:
    found, publisher = output()
    publisher.hearers = 0
    assert found.halt(0) == "no node subscribes to cmd_vel"
    found.active, found.error = None, "somebody else commands it"
    assert found.halt(0) == "somebody else commands it"


# --- the graph ------------------------------------------------------------------------------------


class Node:
    """A node of the name `colony`, and the ends of its topic."""

    def __init__(self, publishers: list[str], subscribers: list[str]) -> None:
        self._publishers, self._subscribers = publishers, subscribers

    def get_name(self) -> str:
        return "colony"

    def get_namespace(self) -> str:
        return "/"

    def resolve_topic_name(self, topic: str) -> str:
        return f"/{topic}"

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        return [_end(node, TWIST, number) for number, node in enumerate(self._publishers)]

    def get_subscriptions_info_by_topic(self, name: str) -> list[Any]:
        return [_end("base", type_, number) for number, type_ in enumerate(self._subscribers)]

    def create_publisher(self, *_: Any) -> Publisher:
        return Publisher()


def _end(node: str, type_: str, number: int) -> Any:
    quality = SimpleNamespace(reliability="reliable", durability="volatile")
    return SimpleNamespace(
        node_name=node, node_namespace="/", topic_type=type_, qos_profile=quality, endpoint_gid=[number]
    )


@pytest.fixture(autouse=True)
def _fake_rclpy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FAKE_RCLPY", str(tmp_path))
    monkeypatch.syspath_prepend(str(Path(__file__).with_name("fake")))
    for name in [name for name in sys.modules if name.partition(".")[0] in ("rclpy", "geometry_msgs")]:
        monkeypatch.delitem(sys.modules, name)


@pytest.mark.parametrize(
    ("before", "publishers", "age_ns", "expected"),
    [
        ([], ["colony"], GHOST_NS, []),
        ([], ["colony", "mux"], 0, ["mux"]),
        ([], ["colony", "colony"], 0, ["colony"]),  # another node of this name, that came later
        (["colony"], ["colony", "colony"], GHOST_NS - 1, []),  # that of a bridge that was killed
        (["colony"], ["colony", "colony"], GHOST_NS, ["colony"]),  # it lives: another node of this name
    ],
)
def test_a_publisher_of_the_same_name_is_its_own_a_ghost_or_another(
    before: list[str], publishers: list[str], age_ns: int, expected: list[str]
) -> None:
    found, _ = output()
    found.active = None
    found.look(Node(before, []), 0)
    found.active = Publisher(), TWIST
    seen = found.look(Node(publishers, [TWIST]), age_ns)
    assert [end[0] for end in seen["publishers"]] == expected


@pytest.mark.parametrize(
    ("publishers", "age_ns", "error"),
    [
        ([], SETTLED_NS - 1, "/cmd_vel is being discovered"),
        ([], SETTLED_NS, ""),
        (["mux"], SETTLED_NS, f"`/mux` ({TWIST}) publishes /cmd_vel already"),
    ],
)
def test_alone_waits_for_the_graph_and_for_others(publishers: list[str], age_ns: int, error: str) -> None:
    found, _ = output(alone=True)
    found.active = None
    assert found.look(Node(publishers, [TWIST]), age_ns)["error"] == error
    assert (found.active is None) == bool(error)
