"""A survey of a graph, over a fake rclpy: what is found, what is heard, and that nothing is published."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from colony.ir.ros2_messages import LASER_SCAN, STANDARD, STRING, TRANSFORMS
from colony.ros2.cdr import encode, structure
from colony.ros2.connection import BridgeError, NodeSettings
from colony.ros2.incoming import ArrivedMessage
from colony.ros2.survey import KEPT, GatheredMessages, SurveyedTopic, readable, survey

FAKE = Path(__file__).with_name("fake")
BOOL, ODD = "std_msgs/msg/Bool", "std_msgs/msg/Odd"
NODE = NodeSettings(python=sys.executable)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PYTHONPATH", str(FAKE))
    monkeypatch.setenv("FAKE_RCLPY", str(tmp_path))
    return tmp_path


def test_topics_their_ends_and_what_they_send_are_found(folder: Path) -> None:
    graph = {
        "/estop": {"publishers": [["panel", BOOL]]},
        "/lamp": {"subscribers": [["lamp", BOOL]]},
        "/odd": {"publishers": [["panel", ODD]]},
    }
    (folder / "graph.json").write_text(json.dumps(graph))
    rows = [{"topic": "/estop", "data": "0001000001"}, {"topic": "/estop", "data": "00010000"}]
    (folder / "inbox").write_text("\n".join(map(json.dumps, rows)))
    estop, lamp, odd = survey(NODE, 0.5)
    assert (estop.name, estop.types, estop.messages) == ("/estop", (BOOL,), ({"data": True},))
    assert estop.fault is not None
    assert "1 byte missing" in estop.fault
    assert [str(end) for end in estop.publishers] == ["`/panel`"]
    assert (lamp.publishers, [str(end) for end in lamp.subscribers]) == ((), ["`/lamp`"])
    assert (odd.types, odd.messages) == ((ODD,), ())
    assert not (folder / "log").exists()


def test_a_bridge_that_cannot_run_is_an_error(folder: Path) -> None:
    (folder / "broken").write_text("")
    with pytest.raises(BridgeError, match="no middleware"):
        survey(NODE, 1.0)


@pytest.mark.parametrize(
    ("name", "types", "read"),
    [
        ("/scan", (LASER_SCAN,), LASER_SCAN),
        ("/scan", (LASER_SCAN, BOOL), None),
        ("/robot/tf_static", (TRANSFORMS,), TRANSFORMS),
        ("/tf", (TRANSFORMS,), None),
        ("/robot_description", (STRING,), STRING),
        ("/robot_description", (BOOL,), None),
        ("/chatter", (STRING,), None),
        ("/image", ("sensor_msgs/msg/Image",), None),
    ],
)
def test_what_is_read(name: str, types: tuple[str, ...], read: str | None) -> None:
    assert readable(name, types) == read


def test_messages_are_counted_and_the_newest_are_kept() -> None:
    kind = structure(STRING, STANDARD)
    gathered = GatheredMessages("/robot_description", kind)
    for i in range(2 * KEPT):
        gathered.put(ArrivedMessage(1 + i * 100_000_000, 0, encode(kind, {"data": str(i)})))
    found = gathered.read(SurveyedTopic(name="/robot_description", types=(STRING,)))
    assert (len(found.messages), found.newest) == (KEPT, {"data": str(2 * KEPT - 1)})
    assert found.rate_hz == pytest.approx(10.0)


def test_a_stamp_in_the_future_is_a_fault() -> None:
    kind = structure(LASER_SCAN, STANDARD)
    gathered = GatheredMessages("/scan", kind)
    gathered.put(ArrivedMessage(1, 0, encode(kind, {"header": {"stamp": {"sec": 3, "nanosec": 0}}})))
    found = gathered.read(SurveyedTopic(name="/scan", types=(LASER_SCAN,)))
    assert found.fault is not None
    assert "stamped 3 s ahead" in found.fault
    assert found.newest is not None
