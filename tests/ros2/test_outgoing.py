"""Messages and goals that are sent: what they lack, and which goal the bridge reports of."""

from __future__ import annotations

import math
from typing import Any

import pytest

from colony.ir.ros2_messages import STANDARD
from colony.ros2.cdr import MessageError, decode, encode, structure
from colony.ros2.incoming import ArrivedMessage, Incoming
from colony.ros2.outgoing import ActionGoals, completed
from colony.ros2.topics import CommandedAction, GoalState, HeardTopic

POSE = structure("geometry_msgs/msg/PoseStamped", STANDARD)
TIMEOUT_NS = 250


def sent(values: dict[str, Any], frame: str = "") -> dict[str, Any]:
    """Return a pose as its receiver reads it."""
    return decode(POSE, encode(POSE, completed(POSE, values, frame)))


def test_a_pose_has_its_frame_and_a_valid_orientation() -> None:
    found = sent({"pose.position.x": 1.5}, "map")
    assert found["header"]["frame_id"] == "map"
    assert found["pose"]["position"] == {"x": 1.5, "y": 0.0, "z": 0.0}
    assert found["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


@pytest.mark.parametrize(
    ("angle", "value", "yaw"),
    [
        ("yaw", 1.0, 1.0),
        ("heading", 0.0, math.pi / 2),
        ("heading", -math.pi / 2, 0.0),
        ("heading", math.pi, 1.5 * math.pi),
    ],
)
def test_an_orientation_is_given_by_an_angle(angle: str, value: float, yaw: float) -> None:
    found = sent({f"pose.orientation.{angle}": value})["pose"]["orientation"]
    assert found == {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def test_what_is_given_stays_as_it_is() -> None:
    found = sent({"pose.orientation.z": 1.0, "header.frame_id": "odom"}, "map")
    assert found["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
    assert found["header"]["frame_id"] == "odom"


@pytest.mark.parametrize(
    "values", [{"pose": 1.0, "pose.position": 1.0}, {"pose.position": 1.0}, {"speed": 1.0}]
)
def test_a_path_that_the_message_does_not_have_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(MessageError):
        sent(values)


# --- goals ----------------------------------------------------------------------------------------


class Stage:
    """An action whose bridge reports what a test says. Mutable."""

    def __init__(self) -> None:
        self.now_ns = 0
        feedback = HeardTopic(Incoming("walk", structure("std_msgs/msg/Bool", STANDARD)), "T", "best_effort")
        self.output = CommandedAction("walk", "a/action/Walk", timeout_ns=TIMEOUT_NS, feedback=feedback)
        self.goals = ActionGoals(self.output, TIMEOUT_NS, lambda: self.now_ns)

    def decide(self, message: bytes = b"goal") -> int:
        """Decide a goal, and return its number."""
        payload = self.goals.payload(message)
        assert payload[4:] == message
        return int.from_bytes(payload[:4], "little")

    def report(self, number: int, state: str) -> None:
        """Take a report of the bridge."""
        self.output.note(GoalState(number, state))

    def hear(self, flag: bool) -> None:
        """Take feedback."""
        self.output.feedback.incoming.put(ArrivedMessage(0, 0, b"\0\1\0\0" + bytes([flag])))


def test_a_goal_has_a_number_that_changes_with_it_and_after_a_pause() -> None:
    stage = Stage()
    assert [stage.decide(), stage.decide(), stage.decide(b"other"), stage.decide()] == [1, 1, 2, 3]
    stage.now_ns = TIMEOUT_NS - 1
    assert stage.decide() == 3
    stage.now_ns += TIMEOUT_NS
    assert stage.decide() == 4
    stage.goals.clear()
    assert stage.decide() == 5


def test_the_state_is_that_of_the_newest_goal() -> None:
    stage = Stage()
    assert stage.goals.state is None
    stage.report(0, "idle")
    assert stage.goals.state == "idle"
    stage.decide()
    assert stage.goals.state == "sent"
    stage.report(1, "succeeded")
    assert stage.goals.state == "succeeded"
    stage.decide(b"other")
    assert stage.goals.state == "sent"
    stage.report(2, "executing")
    assert stage.goals.state == "executing"
    stage.now_ns = TIMEOUT_NS
    assert stage.goals.state == "idle"
    stage.decide(b"other")
    stage.report(2, "canceled")  # of the goal before the pause
    assert stage.goals.state == "sent"
    stage.output.forget()
    assert stage.goals.state is None


def test_feedback_is_that_on_the_newest_goal() -> None:
    stage = Stage()
    stage.decide()
    stage.report(1, "executing")
    stage.hear(True)
    found = stage.goals.feedback()
    assert found is not None
    assert found.values == {"data": True}
    stage.decide(b"other")
    assert stage.goals.feedback() is None
    stage.report(2, "sent")
    assert stage.goals.feedback() is None  # what came before is over
    stage.hear(False)
    assert stage.goals.feedback() is not None
    stage.goals.clear()
    assert stage.goals.feedback() is None
