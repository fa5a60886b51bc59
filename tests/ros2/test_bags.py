"""Bags as connections: what arrives when, of which type, and by which clock."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from colony.ros2.bags import BEGIN_NS, CLOCK_TYPE, Bag, BagConnection, BagError, resolved
from colony.ros2.cdr import Definition
from colony.ros2.connection import NodeSettings
from colony.ros2.topics import HeardTopic
from tests.ros2.bag import START_NS, TWIST, TWIST_STAMPED, Written, odom, scan, stamp, twist, write

pytest.importorskip("rosbags")

MS = 1_000_000
ODOM, SCAN = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"
LEVELS = "robot_msgs/msg/Levels"
CUSTOM: dict[str, Definition] = {
    "robot_msgs/msg/Level": (("name", "string<8>"), ("value", "float"), ("flags", "boolean[2]")),
    LEVELS: (("header", "std_msgs/Header"), ("levels", "sequence<robot_msgs/Level, 4>")),
}
MSG = """std_msgs/Header header
robot_msgs/Level[<=4] levels
================================================================================
MSG: robot_msgs/Level
string<=8 name
float32 value
bool[2] flags
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
LINE = "=" * 80
IDL = f"""{LINE}
IDL: robot_msgs/msg/Levels
#include "std_msgs/msg/Header.idl"
module robot_msgs {{ module msg {{ struct Levels {{
  std_msgs::msg::Header header;
  sequence<robot_msgs::msg::Level, 4> levels;
}}; }}; }};

{LINE}
IDL: robot_msgs/msg/Level
module robot_msgs {{ module msg {{
  typedef boolean boolean__2[2];
  struct Level {{
    string<8> name;
    float value;
    boolean__2 flags;
}}; }}; }};
"""


def opened(folder: Path, messages: Iterable[Written], **options: Any) -> Bag:
    return Bag(write(folder / "bag", messages, **options))


def connected(bag: Bag, **node: Any) -> BagConnection:
    return BagConnection(bag, NodeSettings(**node))


def x(heard: HeardTopic) -> float | None:
    message = heard.incoming.message()
    return None if message is None else message.values["pose"]["pose"]["position"]["x"]


def test_messages_arrive_when_the_recorder_received_them(tmp_path: Path) -> None:
    with opened(tmp_path, [odom(0.0, 1.0), odom(0.1, 2.0), odom(0.2, 3.0)]) as bag:
        assert (bag.start_ns, bag.end_ns) == (START_NS, START_NS + 200 * MS)
        connection = connected(bag)
        heard = connection.hear("odom", ODOM)
        for t_ms, expected, goes_on in ((0, 1.0, True), (99, 1.0, True), (100, 2.0, True), (201, 3.0, False)):
            assert connection.advance(t_ms * MS) is goes_on
            assert x(heard) == expected
            assert connection.now_ns() == BEGIN_NS + t_ms * MS


def test_a_message_was_measured_at_its_stamp(tmp_path: Path) -> None:
    late = scan(0.5, header=stamp(0.3, "laser"))
    with opened(tmp_path, [odom(0.0), late, scan(0.6, header=stamp(0.7, "laser"))]) as bag:
        connection = connected(bag)
        heard = connection.hear("scan", SCAN, frame="laser")
        connection.advance(500 * MS)
        message = heard.incoming.message()
        assert message is not None
        assert message.t_ns == BEGIN_NS + 300 * MS
        connection.advance(600 * MS)
        assert heard.incoming.message() is None
        assert "stamped 0.1 s ahead of the clock" in (heard.problem or "")


def test_either_twist_is_heard_and_no_other_type(tmp_path: Path) -> None:
    stamped = Written(0.1, "/cmd_vel", TWIST_STAMPED, {"twist": {"linear": {"x": 0.5}}})
    for name, messages, type_ in (("a", [twist(0.0, 0.1)], TWIST), ("b", [stamped], TWIST_STAMPED)):
        with opened(tmp_path / name, messages) as bag:
            assert bag.types == {"/cmd_vel": (type_,)}
            connection = connected(bag)
            heard = connection.hear("cmd_vel", "auto")
            other = connection.hear("cmd_vel", "std_msgs/msg/Bool")
            connection.advance(0)
            assert heard.incoming.message() is not None
            assert other.incoming.message() is None


def test_a_topic_of_two_types_has_that_with_more_messages_first(tmp_path: Path) -> None:
    stamped = Written(0.1, "/cmd_vel", TWIST_STAMPED, {})
    with opened(tmp_path, [stamped, twist(0.2, 0.1), twist(0.3, 0.2)]) as bag:
        assert bag.types["/cmd_vel"] == (TWIST, TWIST_STAMPED)
        connection = connected(bag)
        heard = connection.hear("cmd_vel", "auto")
        connection.advance(200 * MS)
        message = heard.incoming.message()
        assert message is not None
        assert message.values["linear"]["x"] == 0.2


def test_a_bag_of_a_clock_that_was_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="19,676 days are between its first and last message"):
        opened(tmp_path, [twist(0.1, 0.1), twist(-1_700_000_000.0, 0.2)])


@pytest.mark.parametrize("definition", [MSG, IDL])
def test_a_type_of_its_own_is_read_by_the_definition_in_the_bag(tmp_path: Path, definition: str) -> None:
    levels = [{"name": "tank", "value": 0.5, "flags": [True, False]}]
    message = Written(0.0, "/levels", LEVELS, {"levels": levels})
    with opened(tmp_path, [message], others=CUSTOM, definition=definition) as bag:
        connection = connected(bag)
        heard = connection.hear("levels", LEVELS)
        connection.advance(0)
        found = heard.incoming.message()
        assert found is not None
        assert found.values["levels"] == ({"name": "tank", "value": 0.5, "flags": (True, False)},)


def test_a_damaged_definition_is_named(tmp_path: Path) -> None:
    message = Written(0.0, "/levels", LEVELS, {})
    match = f"its definition of {LEVELS} is damaged"
    with (
        opened(tmp_path, [message], others=CUSTOM, definition="?") as bag,
        pytest.raises(BagError, match=match),
    ):
        connected(bag).hear("levels", LEVELS)


def ticks(times: Iterable[tuple[float, float]]) -> list[Written]:
    """Return the messages of a simulated clock: the recorder's time, and what it shows, in s."""
    return [
        Written(
            t_s, "/clock", CLOCK_TYPE, {"clock": {"sec": int(shown_s), "nanosec": round(shown_s % 1 * 1e9)}}
        )
        for t_s, shown_s in times
    ]


def test_with_a_simulated_clock_stamps_are_held_to_it(tmp_path: Path) -> None:
    header = {"stamp": {"sec": 99, "nanosec": 900 * MS}, "frame_id": "laser"}
    messages = [*ticks([(0.0, 100.0)]), scan(0.05, header=header)]
    for is_simulated, taken_ms in ((True, -50), (False, 50)):
        with opened(tmp_path / str(is_simulated), messages) as bag:
            connection = connected(bag, use_sim_time=is_simulated)
            heard = connection.hear("scan", SCAN)
            connection.advance(50 * MS)
            message = heard.incoming.message()
            assert message is not None
            assert message.t_ns == BEGIN_NS + taken_ms * MS


def test_a_clock_that_stands_still_is_a_pause(tmp_path: Path) -> None:
    messages = ticks([(0.0, 100.0), (0.1, 100.1), (0.4, 100.1), (1.0, 100.2), (1.1, 100.3)])
    with opened(tmp_path, messages) as bag:
        connection = connected(bag, use_sim_time=True)
        found = {}
        for t_ms in range(0, 1150, 50):
            connection.advance(t_ms * MS)
            found[t_ms] = connection.is_paused
        assert [t_ms for t_ms, is_paused in found.items() if is_paused] == list(range(600, 1000, 50))


def test_a_bag_is_not_commanded(tmp_path: Path) -> None:
    with opened(tmp_path, [odom(0.0)]) as bag:
        connection = connected(bag)
        for call in (connection.command, lambda topic: connection.decide(topic, b"")):
            with pytest.raises(ConnectionError):
                call(None)


@pytest.mark.parametrize(
    ("topic", "namespace", "expected"),
    [
        ("scan", "", "/scan"),
        ("scan", "/r1/", "/r1/scan"),
        ("front/scan", "r1", "/r1/front/scan"),
        ("/scan", "r1", "/scan"),
        ("~/goal", "r1", "/r1/colony/goal"),
        ("~/goal", "", "/colony/goal"),
    ],
)
def test_names_are_resolved_as_those_of_a_node(topic: str, namespace: str, expected: str) -> None:
    assert resolved(topic, "colony", namespace) == expected
