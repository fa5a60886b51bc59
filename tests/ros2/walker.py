"""An action server that knows nothing of colony: rclpy alone, test_msgs/action/Fibonacci, 20 steps a second.

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
from test_msgs.action import Fibonacci

settings = {"accepts": True, "aborts": False, "preempts": False, "steps": 100_000}
newest = [0]


def say(**row) -> None:
    print(json.dumps({"t": time.monotonic_ns(), **row}), flush=True)


def read() -> None:
    for line in sys.stdin:
        settings.update(json.loads(line))
    os._exit(0)


def judge(goal) -> GoalResponse:
    say(asked=goal.order)
    return GoalResponse.ACCEPT if settings["accepts"] else GoalResponse.REJECT


def execute(handle):
    order = handle.request.order
    newest[0] = order
    say(began=order)
    for i in range(settings["steps"]):
        if handle.is_cancel_requested:
            handle.canceled()
            say(ended=order, state="canceled")
            return Fibonacci.Result()
        if settings["preempts"] and newest[0] != order:
            handle.abort()
            say(ended=order, state="preempted")
            return Fibonacci.Result()
        if settings["aborts"]:
            handle.abort()
            say(ended=order, state="aborted")
            return Fibonacci.Result()
        handle.publish_feedback(Fibonacci.Feedback(sequence=[order, i]))
        time.sleep(0.05)
    handle.succeed()
    say(ended=order, state="succeeded")
    return Fibonacci.Result()


def main() -> None:
    settings.update(json.loads(sys.argv[1]))
    rclpy.init(args=[])
    node = rclpy.create_node("walker")
    server = ActionServer(
        node,
        Fibonacci,
        "walk",
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
