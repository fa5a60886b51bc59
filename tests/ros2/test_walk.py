"""An action over a genuine ROS 2: its goals, their ends, and what becomes of them when something dies."""

from __future__ import annotations

import json
import math
import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress

import pytest

from colony.ros2.drivers import Ros2Device
from colony.runs.ros2_devices import ros2_hardware
from tests.body.test_ros2 import loaded
from tests.cli.machine import children_of
from tests.ros2.burger import BODY, GOING, NAV
from tests.ros2.environment import existing
from tests.ros2.nav2 import has_nav2
from tests.ros2.ros import STATES, WALKING, Ros, Walker
from tests.waiting import until

pytestmark = pytest.mark.ros2

PATIENCE_S = 60.0


class Walk:
    """The driver of the action, decided in frames of 50 ms. Mutable: the states that it went through."""

    def __init__(self, ros: Ros) -> None:
        self.reports: list[str] = []
        self.states: list[str | None] = []
        connection = ros.connection(self.reports.append)
        self.driver = Ros2Device(ros.node(), json.dumps(WALKING), connection=connection)

    @property
    def state(self) -> str | None:
        """The state of the goal."""
        reading = self.driver.fields()["state"]
        found = None if reading is None else STATES[int(reading.value)]  # type: ignore[arg-type]
        if self.states[-1:] != [found]:
            self.states.append(found)
        return found

    def field(self, name: str) -> object:
        """Return a part of the feedback."""
        reading = self.driver.fields()[name]
        return None if reading is None else reading.value

    def go(self, order: int | None, is_done: Callable[[], bool], what: str) -> None:
        """Decide a goal in each frame, or none, until something happens."""

        def step() -> bool:
            time.sleep(0.05)
            _ = self.state
            if order is not None:
                try:
                    self.driver.command("walk", {"order": float(order)})
                except ConnectionError:
                    return False
            return is_done()

        until(step, f"{what}: {self.states}, {self.driver.problem}, {self.reports}", patience_s=PATIENCE_S)

    def go_until(self, order: int | None, state: str) -> None:
        """Decide a goal in each frame, or none, until it has a state."""
        self.go(order, lambda: self.state == state, state)


def test_a_goal_is_followed_to_its_end_and_sent_once(ros: Ros) -> None:
    walker, walk = ros.walker(steps=20), Walk(ros)
    walk.go_until(None, "idle")
    walk.go_until(3, "executing")
    walk.go(3, lambda: walk.field("step") == 10.0, "feedback")
    assert walk.field("order") == 3.0
    assert walk.driver.problem is None
    walk.go_until(3, "succeeded")
    until_s = time.monotonic() + 0.5
    walk.go(3, lambda: time.monotonic() > until_s, "it stays")
    assert walk.states[-3:] == ["sent", "executing", "succeeded"]
    assert walker.said("asked") == [3]
    walk.go_until(None, "idle")
    assert walk.field("order") is None
    walk.go_until(3, "executing")
    assert walker.said("asked") == [3, 3]


@pytest.mark.parametrize(
    ("setting", "state"), [({"aborts": True}, "aborted"), ({"accepts": False}, "rejected")]
)
def test_a_goal_that_fails_says_how_and_is_not_sent_again(
    ros: Ros, setting: dict[str, bool], state: str
) -> None:
    walker, walk = ros.walker(**setting), Walk(ros)
    walk.go_until(4, state)
    until_s = time.monotonic() + 0.5
    walk.go(4, lambda: time.monotonic() > until_s, "it stays")
    assert walk.state == state
    assert walker.said("asked") == [4]


def test_a_goal_is_canceled_when_it_is_decided_no_more_and_at_a_stop(ros: Ros) -> None:
    walker, walk = ros.walker(), Walk(ros)
    walk.go_until(1, "executing")
    walk.go(None, lambda: walker.end(1) == "canceled", "it is canceled")
    assert walk.state == "idle"
    walk.go_until(2, "executing")
    walk.driver.safe()
    assert walk.state == "idle"
    until(lambda: walker.end(2) == "canceled", "it is canceled", patience_s=PATIENCE_S)
    until(lambda: walk.driver.unreached is None, "the stop is acknowledged", patience_s=PATIENCE_S)


@pytest.mark.parametrize(("preempts", "end"), [(True, "preempted"), (False, "canceled")])
def test_another_goal_takes_the_place_of_the_one_before(ros: Ros, preempts: bool, end: str) -> None:
    walker, walk = ros.walker(preempts=preempts), Walk(ros)
    until(lambda: not walk.driver.is_opening and walk.driver.problem is None, "it is served")
    walk.go_until(1, "executing")
    walk.go(2, lambda: walker.end(1) == end, end)
    assert walk.state == "executing"
    walk.go(2, lambda: walk.field("order") == 2.0, "the feedback is that on the new goal")
    assert walker.end(2) is None
    assert walk.states[-2:] == ["sent", "executing"]
    assert not {"lost", "canceled", "aborted"} & set(walk.states)


def test_a_goal_of_a_killed_server_is_lost_and_sent_to_the_next_one(ros: Ros) -> None:
    walker, walk = ros.walker(), Walk(ros)
    walk.go_until(1, "executing")
    walker.process.kill()
    later = ros.walker()
    walk.go(1, lambda: later.said("began") == [1], "the next server has it")
    walk.go_until(1, "executing")
    later.process.kill()
    walk.go_until(1, "lost")  # as soon as the middleware finds it, 20 s with Fast DDS
    assert "no node serves /walk" in (walk.driver.problem or "")
    walk.go_until(None, "idle")
    last = ros.walker()
    until(lambda: walk.driver.problem is None, "it is back", patience_s=PATIENCE_S)
    assert not last.said("asked")


def test_nav2_gets_the_pose_that_is_commanded_and_says_how_far_it_is(ros: Ros) -> None:
    made = existing()
    if made is None or not has_nav2(made):
        pytest.skip("there is no nav2_msgs: `python -m tests.ros2.nav2` builds it")
    robot, body = loaded(GOING, BODY + NAV)
    topics = str(ros2_hardware("Nav", body, robot).options["topics"])
    server, reports = ros.walker(nav2=True), list[str]()
    driver = Ros2Device(ros.node(), topics, connection=ros.connection(reports.append))

    def value(name: str) -> object:
        reading = driver.fields()[name]
        return None if reading is None else reading.value

    def step() -> bool:
        time.sleep(0.05)
        with suppress(ConnectionError):
            driver.command("goto", {"x": 4.0, "y": -1.5, "heading": 0.0})
        return value("tries") == 3.0

    until(step, f"feedback: {driver.problem}, {reports}", patience_s=PATIENCE_S)
    half = math.sqrt(0.5)  # north is yaw 90 degrees
    assert server.said("asked") == [["map", 4.0, -1.5, pytest.approx(half), pytest.approx(half)]]
    assert value("status") == float(STATES.index("executing"))
    assert isinstance(value("distance_remaining"), float)
    driver.safe()
    until(lambda: server.said("ended"), "it is canceled", patience_s=PATIENCE_S)


def bridge_of(pid: int) -> int:
    """Return the process id of the bridge of a process."""
    (bridge,) = children_of(pid)
    return int(bridge)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_the_goal_of_a_process_that_dies_or_freezes_is_canceled(ros: Ros, number: signal.Signals) -> None:
    walker, driver = ros.walker(), ros.walker_process()
    until(lambda: walker.said("began") == [5], "it walks", patience_s=PATIENCE_S)
    driver.send_signal(number)
    until(lambda: walker.end(5) == "canceled", "it is canceled", patience_s=PATIENCE_S)


def test_the_goal_of_a_killed_bridge_is_canceled_by_the_next_one(ros: Ros) -> None:
    walker, driver = ros.walker(), ros.walker_process()
    until(lambda: walker.said("began") == [5], "it walks", patience_s=PATIENCE_S)
    os.kill(bridge_of(driver.pid), signal.SIGKILL)
    until(lambda: walker.said("began") == [5, 5], "the next bridge sends it again", patience_s=PATIENCE_S)
    until(lambda: walker.said("ended") == [5], "the first one is canceled", patience_s=PATIENCE_S)


def test_a_goal_is_followed_by_the_next_process_after_both_were_killed(ros: Ros) -> None:
    walker, driver = ros.walker(), ros.walker_process()
    until(lambda: walker.said("began") == [5], "it walks", patience_s=PATIENCE_S)
    bridge = bridge_of(driver.pid)
    os.kill(bridge, signal.SIGSTOP)
    driver.kill()
    os.kill(bridge, signal.SIGKILL)
    walk = Walk(ros)  # which decides nothing
    until(lambda: walker.end(5) == "canceled", "the stray is canceled", patience_s=PATIENCE_S)
    assert walk.state == "idle"


def test_an_action_that_nobody_serves_is_named(ros: Ros) -> None:
    walk = Walk(ros)
    walk.go_until(1, "lost")
    until(lambda: walk.driver.problem == "no node serves /walk", "it is named", patience_s=PATIENCE_S)
    walker: Walker = ros.walker()
    walk.go_until(1, "executing")
    assert walker.said("asked") == [1]
