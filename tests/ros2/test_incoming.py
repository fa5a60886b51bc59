"""Messages that arrive: their age, their parts, and those that are refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from colony.ir.ros2_messages import ODOMETRY, STANDARD
from colony.ros2.cdr import encode, structure
from colony.ros2.incoming import ArrivedMessage, Incoming, SimulatedClock, measured_ns, part
from colony.ros2.scan import UnusableError

KIND = structure(ODOMETRY, STANDARD)
MS = 1_000_000
NOW = 1_000_000 * MS


def odometry(frame: str = "odom", sec: int = 0, **values: Any) -> bytes:
    """Return a message with a header."""
    return encode(KIND, {"header": {"frame_id": frame, "stamp": {"sec": sec}}, **values})


@pytest.mark.parametrize(
    ("age_ms", "expected_ms"),
    [(0, 0), (1, 1), (1000, 1000), (1001, 0), (10**9, 0), (-1, 0), (-50, 0)],
)
def test_a_stamp_adds_to_the_age_while_it_is_up_to_a_second_old(age_ms: int, expected_ms: int) -> None:
    arrived = ArrivedMessage(NOW, 77 * NOW, b"")
    assert measured_ns(arrived, 77 * NOW - age_ms * MS) == NOW - expected_ms * MS


def test_a_stamp_of_0_is_none() -> None:
    assert measured_ns(ArrivedMessage(NOW, 10 * MS, b""), 0) == NOW


def test_a_stamp_of_the_future_is_refused() -> None:
    with pytest.raises(UnusableError, match=r"stamped 0.051 s ahead of the clock"):
        measured_ns(ArrivedMessage(NOW, NOW, b""), NOW + 51 * MS)


def test_a_message_is_decoded_once_and_the_newest_counts() -> None:
    incoming = Incoming("odom", KIND, "odom")
    assert incoming.message() is None
    incoming.put(ArrivedMessage(5, 0, odometry()))
    first = incoming.message()
    assert first is not None
    assert first.t_ns == 5
    assert incoming.message() is first
    incoming.put(ArrivedMessage(6, 0, odometry()))
    assert incoming.message() is not first
    incoming.put(None)
    assert incoming.message() is None
    assert incoming.fault is None


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (odometry("map"), "odom: the frame is `map`; expected `odom`"),
        (odometry(sec=1), "odom: stamped 1 s ahead of the clock"),
        (odometry()[:-1], "odom: `nav_msgs/msg/Odometry` is damaged: 1 byte missing"),
        (b"", "odom: `nav_msgs/msg/Odometry` begins with nothing"),
    ],
)
def test_an_unusable_message_is_none_and_says_why_until_the_next(data: bytes, why: str) -> None:
    incoming = Incoming("odom", KIND, "odom")
    incoming.put(ArrivedMessage(5, 0, data))
    assert incoming.message() is None
    assert incoming.fault is not None
    assert incoming.fault.startswith(why)
    incoming.put(ArrivedMessage(6, 0, odometry()))
    assert incoming.message() is not None
    assert incoming.fault is None


def test_a_clock_that_stands_still_while_others_go_on_is_paused() -> None:
    clock = SimulatedClock()
    assert not clock.is_paused
    clock.note(0, 7)
    clock.note(499 * MS, 7)
    assert not clock.is_paused
    clock.note(500 * MS, 7)
    assert clock.is_paused
    clock.note(501 * MS, 8)
    assert not clock.is_paused


def rotation(yaw: float, scale: float = 1.0) -> dict[str, float]:
    """Return a quaternion around the vertical axis."""
    return {"x": 0.0, "y": 0.0, "z": scale * math.sin(yaw / 2), "w": scale * math.cos(yaw / 2)}


VALUES = {
    "axes": (0.0, 0.5),
    "data": 3,
    "orientation": rotation(math.pi / 2, 1.1),
    "orientation_covariance": (0.0,) * 9,
    "linear_acceleration": {"x": 1.0},
    "linear_acceleration_covariance": (-1.0,) * 9,
}


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("axes", (0.0, 0.5)),
        ("axes[1]", 0.5),
        ("data", 3),
        ("orientation.w", 1.1 * math.cos(math.pi / 4)),
        ("orientation.yaw", math.pi / 2),
        ("orientation.roll", 0.0),
        ("orientation.pitch", 0.0),
        ("linear_acceleration.x", None),  # by its covariance, it is not known
    ],
)
def test_a_path_names_a_part_of_a_message(path: str, expected: Any) -> None:
    assert part(VALUES, path) == (expected if not isinstance(expected, float) else pytest.approx(expected))


@pytest.mark.parametrize("path", ["axis", "axes[2]", "data.x", "data[0]", "orientation.yaw.x", "axes.yaw"])
def test_a_path_that_the_message_has_not_is_refused(path: str) -> None:
    with pytest.raises(UnusableError, match="it has no `"):
        part(VALUES, path)


@pytest.mark.parametrize(("yaw_deg", "heading_deg"), [(0, 270), (90, 0), (180, 90), (-90, 180), (100, 10)])
def test_a_heading_is_0_north_and_counterclockwise(yaw_deg: float, heading_deg: float) -> None:
    found = part({"q": rotation(math.radians(yaw_deg))}, "q.heading")
    assert 0.0 <= found < math.tau
    assert (math.degrees(found) - heading_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)


def test_a_quaternion_of_zeros_is_no_rotation() -> None:
    with pytest.raises(UnusableError, match="no rotation"):
        part({"q": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}}, "q.yaw")
