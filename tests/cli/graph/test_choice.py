"""The choice of topics from a graph: of the base, of the scan and its mounting, of names."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from colony.cli.robot.graph.choice import ScanElements, choose, scan_elements, sensor_name
from colony.ir.ros2_messages import BOOL, LASER_SCAN, TWIST_STAMPED
from tests.cli.graph.graphs import drive, odometry, scan, topic, transforms, turtlebot

UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
ROLLED = {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}
BEHIND = {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}


def test_a_turtlebot_needs_no_word() -> None:
    chosen = choose(turtlebot())
    assert chosen.notes == ()
    assert [t.name for t in chosen.used] == ["/cmd_vel", "/odom", "/scan", "/battery_state", "/imu"]
    assert [t.name for t in chosen.unused] == ["/joint_states"]
    assert chosen.base == "base_footprint"
    assert chosen.wheel_base_m == pytest.approx(0.16)
    assert chosen.scan is not None
    assert (chosen.scan.x_m, chosen.scan.bearing_deg, chosen.scan.is_placed) == (
        pytest.approx(-0.032),
        0.0,
        True,
    )
    assert chosen.scan.has_zeros


def degrees(first: float, step: float, count: int) -> dict[str, Any]:
    return {
        "angle_min": math.radians(first),
        "angle_increment": math.radians(step),
        "ranges": [1.0] * count,
    }


@pytest.mark.parametrize(
    ("first", "step", "count", "bearing", "is_upside_down", "expected"),
    [
        (0, 1, 360, 0, False, (-180, 1, 360)),
        (0, 360 / 359, 360, 0, False, (-180, 1, 360)),  # 360 beams from 0 to 360 deg
        (-180, 1, 361, 0, False, (-180, 1, 360)),
        (180, -1, 360, 0, False, (-180, 1, 360)),
        (0, 360 / 230, 230, 0, False, (-180, 2, 180)),
        (-135, 0.25, 1081, 0, False, (-135, 0.5, 541)),
        (-90, 1, 181, 0, False, (-90, 1, 181)),
        (-30, 1, 91, 0, True, (-60, 1, 91)),
        (-30, 1, 91, 10, False, (-20, 1, 91)),
        (-90, 1, 181, 180, False, (90, 1, 181)),
        (-120.3, 0.36, 667, 0, False, (-120, 0.5, 479)),
    ],
)
def test_elements_are_at_round_bearings(
    first: float, step: float, count: int, bearing: float, is_upside_down: bool, expected: tuple[float, ...]
) -> None:
    found = scan_elements(degrees(first, step, count), bearing, is_upside_down)
    assert found is not None
    assert (found.first_deg, found.step_deg, found.count) == expected
    assert found.is_full == (found.count * found.step_deg == 360)


@pytest.mark.parametrize(("step", "count"), [(0.0, 360), (1.0, 1), (math.nan, 10), (60.0, 6)])
def test_angles_without_sense_have_no_elements(step: float, count: int) -> None:
    assert scan_elements(degrees(0.0, step, count), 0.0, False) is None


@pytest.mark.parametrize(
    ("place", "rotation", "expected"),
    [
        ({"x": 0.1, "y": 0.0, "z": 0.2}, UPRIGHT, (0.1, 0.0, False)),
        ({"x": 0.1, "y": 0.0, "z": 0.2}, ROLLED, (0.1, 0.0, True)),
        ({"x": -0.1, "y": 0.0, "z": 0.2}, BEHIND, (-0.1, 180.0, False)),
    ],
)
def test_the_scanner_is_where_tf_static_has_it(
    place: dict[str, float], rotation: dict[str, float], expected: tuple[float, float, bool]
) -> None:
    chosen = choose([*turtlebot(), transforms(("base_footprint", "base_scan", place, rotation))]).scan
    assert chosen is not None
    assert (chosen.x_m, abs(chosen.bearing_deg), chosen.is_upside_down) == expected


def test_a_scanner_without_a_transform_or_that_looks_up_is_noted() -> None:
    chosen = choose([scan(frame="laser"), odometry()])
    assert "/scan: no transform from `laser` to `base_footprint`: its pose is guessed" in chosen.notes
    up = {"x": 0.0, "y": -math.sqrt(0.5), "z": 0.0, "w": math.sqrt(0.5)}
    joints = transforms(("base_footprint", "laser", {"x": 0.0, "y": 0.0, "z": 0.0}, up))
    assert any(
        "does not look along the floor" in n for n in choose([scan(frame="laser"), odometry(), joints]).notes
    )


def test_among_several_the_choice_is_noted() -> None:
    graph = [*turtlebot(), scan("/rear/scan"), odometry("/odometry/filtered"), topic("/far_scan", LASER_SCAN)]
    chosen = choose(graph)
    assert chosen.scan is not None
    assert chosen.scan.topic.name == "/scan"
    assert chosen.notes == (
        "odometry: took /odom, and not /odometry/filtered",
        "scan: took /scan, and not /rear/scan, /far_scan",
    )


def test_a_scan_that_never_came_is_left_out() -> None:
    chosen = choose([topic("/scan", LASER_SCAN), drive()])
    assert chosen.scan is None
    assert "/scan: nothing arrived, so it is left out" in chosen.notes


def test_who_drives_now_is_named_and_a_drive_without_subscriber_is_guessed() -> None:
    chosen = choose([drive("/base/cmd_vel", TWIST_STAMPED, publishers=1), odometry()])
    assert chosen.drive is not None
    assert chosen.drive.name == "/base/cmd_vel"
    (note,) = chosen.notes
    assert note.startswith("`/node0` commands /base/cmd_vel now")
    chosen = choose([drive(subscribers=0, publishers=1), odometry()])
    assert chosen.drive is None
    assert chosen.notes == ("no node subscribes to a twist: `cmd_vel` is guessed",)


def test_topics_of_other_namespaces_are_left_alone() -> None:
    graph = [drive("/one/cmd_vel"), drive("/two/cmd_vel"), odometry("/one/odom"), odometry("/two/odom")]
    chosen = choose(graph, "two")
    assert [t.name for t in chosen.used] == ["/two/cmd_vel", "/two/odom"]
    assert [chosen.relative(t) for t in chosen.used] == ["cmd_vel", "odom"]
    assert chosen.unused == chosen.notes == ()


def test_a_stamp_in_the_future_is_noted_unless_time_is_simulated() -> None:
    ahead = replace(odometry(), fault="stamped 3 s ahead of the clock")
    clock = replace(topic("/clock", BOOL), types=("rosgraph_msgs/msg/Clock",))
    assert "/odom: stamped 3 s ahead of the clock" in choose([ahead, drive()]).notes
    chosen = choose([ahead, drive(), clock])
    assert chosen.is_simulated
    assert chosen.notes == ()


@pytest.mark.parametrize(
    ("topic_name", "name"),
    [
        ("/safety/e_stop", "safety_e_stop"),
        ("/arm/Load", "arm_load"),
        ("/3d/gas", "topic_3d_gas"),
        ("/missing", "missing_value"),
        ("/drive", "drive_value"),
        ("/battery", "battery_value"),
        ("/a/b", "a_b_2"),
        ("/" + "long" * 50, "long" * 10),
    ],
)
def test_names_of_sensors_are_names_of_the_language(topic_name: str, name: str) -> None:
    assert sensor_name(topic_name, {"a_b"}) == name


def test_topics_of_one_value_are_sensors_unless_ros_hides_them() -> None:
    graph = [
        topic("/a/b", BOOL),
        topic("/a_b", BOOL),
        topic("/_hidden", BOOL),
        topic("/heard", BOOL, publishers=0),
    ]
    chosen = choose([*graph, drive()])
    assert {name: t.name for name, t in chosen.values.items()} == {"a_b": "/a/b", "a_b_2": "/a_b"}
    assert ScanElements(first_deg=-90.0, step_deg=1.0, count=181).last_deg == 90.0
