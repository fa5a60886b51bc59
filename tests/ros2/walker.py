"""An action server that knows nothing of colony: rclpy alone, 20 steps a second.

Its action is `walk`, a Fibonacci of test_msgs, or with the setting `nav2` Nav2's `navigate_to_pose`.
Lines of JSON on standard input change its settings; what happens to goals are lines on standard output.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.executors import MultiThreadedExecutor

settings = {"accepts": True, "aborts": False, "preempts": False, "steps": 100_000, "nav2": False}
settings.update(json.loads(sys.argv[1]))
if settings["nav2"]:
    from nav2_msgs.action import NavigateToPose as Action
else:
    from test_msgs.action import Fibonacci as Action
newest = [0]


def order_of(goal):
    if not settings["nav2"]:
        return goal.order
    place, turned = goal.pose.pose.position, goal.pose.pose.orientation
    return [goal.pose.header.frame_id, place.x, place.y, turned.z, turned.w]


def feedback(order, step: int):
    if not settings["nav2"]:
        return Action.Feedback(sequence=[order, step])
    return Action.Feedback(distance_remaining=10.0 - step, number_of_recoveries=3)


def say(**row) -> None:
    print(json.dumps({"t": time.monotonic_ns(), **row}), flush=True)


def read() -> None:
    for line in sys.stdin:
        settings.update(json.loads(line))
    os._exit(0)


def judge(goal) -> GoalResponse:
    say(asked=order_of(goal))
    return GoalResponse.ACCEPT if settings["accepts"] else GoalResponse.REJECT


def execute(handle):
    order = order_of(handle.request)
    newest[0] = order
    say(began=order)
    for i in range(settings["steps"]):
        if handle.is_cancel_requested:
            handle.canceled()
            say(ended=order, state="canceled")
            return Action.Result()
        if settings["preempts"] and newest[0] != order:
            handle.abort()
            say(ended=order, state="preempted")
            return Action.Result()
        if settings["aborts"]:
            handle.abort()
            say(ended=order, state="aborted")
            return Action.Result()
        handle.publish_feedback(feedback(order, i))
        time.sleep(0.05)
    handle.succeed()
    say(ended=order, state="succeeded")
    return Action.Result()


def main() -> None:
    rclpy.init(args=[])
    node = rclpy.create_node("walker")
    server = ActionServer(
        node,
        Action,
        "navigate_to_pose" if settings["nav2"] else "walk",
        execute,
        goal_callback=judge,
        cancel_callback=lambda goal: CancelResponse.ACCEPT,
    )
    threading.Thread(target=read, daemon=True).start()
    executor = MultiThreadedExecutor(6)
    executor.add_node(node)
    say(ready=True)
    executor.spin()
    server.destroy()


if __name__ == "__main__":
    main()
