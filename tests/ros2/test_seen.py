"""A served robot as another node of ROS 2 sees it: services, winners and diagnostics."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from tests.ros2.ros import Foreign, Ros
from tests.ros2.test_served import Served
from tests.waiting import until

pytestmark = pytest.mark.ros2

TRIGGER = "std_srvs/srv/Trigger"
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("seen")
    with ExitStack() as stack:
        ros = Ros(folder)
        stack.callback(ros.close)
        site = folder / "lab.toml"
        site.write_text('clearance = "0.7 m"\n')
        found = Served(ros, folder, "--params", str(site), "--unproved")
        stack.enter_context(closing(found.machine))
        until(found.drives, "it drives", patience_s=PATIENCE_S)
        yield found


def answer(robot: Foreign, service: str, type_: str = TRIGGER, **values: Any) -> dict[str, Any]:
    """Return the answer to a call of a service by the foreign robot."""
    before = len(robot.others.get(service, ()))
    robot.set(call=[service, type_, values])
    until(lambda: len(robot.others.get(service, ())) > before, service, patience_s=PATIENCE_S)
    return robot.others[service][-1]


def winner(robot: Foreign) -> dict[str, Any]:
    """Return the newest winners."""
    heard = robot.others.get("/burger/winner")
    found: dict[str, Any] = json.loads(heard[-1]["data"]) if heard else {}
    return found.get("drive", {})


def diagnosis(robot: Foreign, name: str) -> tuple[str, str]:
    """Return the level and the message of the newest diagnosis of a name."""
    rows = [row for each in robot.others.get("/diagnostics", [])[-1:] for row in each["status"]]
    return next(((row["level"], row["message"]) for row in rows if row["name"] == name), ("", ""))


def test_the_robot_is_stopped_and_released_by_services(served: Served) -> None:
    robot = served.robot
    found = answer(robot, "/burger/stop")
    assert found["success"], found["message"]
    assert found["message"].startswith("stopped; acknowledged by Clock, ")
    assert "RServer" in found["message"]
    until(lambda: robot.heard[-1]["v"] == 0.0 == robot.heard[-1]["w"], "it stands")
    assert answer(robot, "/burger/release") == {"success": True, "message": "released"}
    until(served.drives, "it drives again")
    refused = answer(robot, "/burger/release")
    assert refused == {"success": False, "message": "no emergency stop is in force"}


def test_a_late_subscriber_hears_the_winner_and_each_change(served: Served) -> None:
    robot = served.robot
    robot.set(hears={**robot_hears(), "/burger/winner": ["std_msgs/msg/String", "latched"]})
    until(lambda: winner(robot).get("by") in ("ahead", "avoid"), "the winner is heard", patience_s=PATIENCE_S)
    robot.set(near=True)
    until(lambda: winner(robot) == {"by": "avoid", "reason": "the only active module"}, "it turns")
    robot.set(near=False)
    until(lambda: winner(robot).get("by") == "ahead", "it drives on")


def robot_hears() -> dict[str, Any]:
    """Return the topics that the foreign robot hears already."""
    return {"lamp": "std_msgs/msg/Float64"}


def test_diagnostics_have_the_servers_and_the_run(served: Served) -> None:
    robot = served.robot
    robot.set(hears={**robot_hears(), "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"})
    until(lambda: diagnosis(robot, "burger: RServer") == ("b'\\x00'", "up"), "RServer", patience_s=PATIENCE_S)
    assert diagnosis(robot, "burger: emergency stop") == ("b'\\x00'", "released")
    until(lambda: diagnosis(robot, "burger: run") == ("b'\\x00'", "runs"), "the run")
    robot.set(second="Twist")
    why = "`/foreign` publishes /cmd_vel as well (geometry_msgs/msg/Twist)"
    until(lambda: diagnosis(robot, "burger: RServer") == ("b'\\x02'", why), why, patience_s=PATIENCE_S)
    robot.set(second=None)
    until(lambda: diagnosis(robot, "burger: RServer") == ("b'\\x00'", "up"), "it is alone again")


def test_params_are_those_of_the_deployment_and_cannot_be_set(served: Served) -> None:
    robot, name = served.robot, "params.clearance"

    def value(name: str) -> dict[str, Any]:
        found = answer(robot, "/burger/get_parameters", "rcl_interfaces/srv/GetParameters", names=[name])
        return found["values"][0] if found["values"] else {}

    until(lambda: value(name).get("string_value") == "0.7 m", "it is declared", patience_s=PATIENCE_S)
    tuned = "params.reach"
    assert value(tuned)["double_value"] == 0.5
    assert served.machine.run("params", "set", "reach=0.7", "--robot", "burger").wait() == 0
    until(lambda: value(tuned).get("double_value") == 0.7, "it is tuned", patience_s=PATIENCE_S)
    listed = answer(
        robot, "/burger/list_parameters", "rcl_interfaces/srv/ListParameters", prefixes=["params"]
    )
    assert set(listed["result"]["names"]) == {name, tuned}
    found = answer(
        robot,
        "/burger/set_parameters",
        "rcl_interfaces/srv/SetParameters",
        parameters=[
            ["rcl_interfaces/msg/Parameter", {"name": name, "value": {"type": 4, "string_value": "1 m"}}]
        ],
    )
    assert not found["results"][0]["successful"]
    assert found["results"][0]["reason"].startswith(f"{name} is read-only")
    served.leader.interrupt()
    until(lambda: value(name).get("type", 0) == 0, "it is gone with the program", patience_s=PATIENCE_S)
