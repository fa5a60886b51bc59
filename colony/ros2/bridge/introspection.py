"""The robot as other nodes of ROS 2 see it: services, diagnostics, winners and params.

    ~/stop, ~/release   std_srvs/srv/Trigger
    ~/winner            std_msgs/msg/String, transient local: the module that commands each actuator, JSON
    /diagnostics        diagnostic_msgs/msg/DiagnosticArray, once a second
    params.NAME         parameters of the node that only a deployment changes

Colony decides what they contain, and answers the calls. What lacks its package is left out.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from colony.ros2.bridge.topics import LATCHED, interface, profile

CALL_S = 15.0
"""Seconds that colony has to answer a call."""

CHECK_S = 0.5
MAX_CALLS = 8
MAX_WAITING = 64

PREFIX = "params."
"""Beginning of the names of parameters that are params of the program."""


class Introspection:
    """The services, topics and parameters. Mutable.

    Args:
        node: the node.
        report: sends colony a report; returns False if it takes none.
    """

    def __init__(self, node: Any, report: Callable[..., bool]) -> None:
        from rclpy.callback_groups import ReentrantCallbackGroup

        self.node, self.report = node, report
        self.waiting: deque[dict[str, Any]] = deque(maxlen=MAX_WAITING)
        self.calls: dict[int, tuple[Any, float]] = {}  # the future of each answer, and when it is due
        self.number = 0
        self.params: list[list[Any]] = []
        self.is_deploying = False
        self.news = node.create_guard_condition(self.apply)
        if (trigger := installed("std_srvs/srv/Trigger")) is not None:
            group = ReentrantCallbackGroup()
            node.create_service(trigger, "~/stop", self.stop, callback_group=group)
            node.create_service(trigger, "~/release", self.release, callback_group=group)
        self.text = installed("std_msgs/msg/String")
        if self.text is not None:
            self.winner = node.create_publisher(self.text, "~/winner", profile(LATCHED))
        self.array = installed("diagnostic_msgs/msg/DiagnosticArray")
        if self.array is not None:
            self.diagnostics = node.create_publisher(self.array, "/diagnostics", profile("reliable"))
        node.add_on_set_parameters_callback(self.on_set)
        node.create_timer(CHECK_S, self.check)

    # --- the thread of the pipe ---------------------------------------------------------------------

    def take(self, packet: dict[str, Any]) -> None:
        """Take what colony sends; the oldest of too many packets is dropped."""
        self.waiting.append(packet)
        self.news.trigger()

    # --- the executor's thread ----------------------------------------------------------------------

    def apply(self) -> None:
        """Publish what colony has sent, and answer calls."""
        while self.waiting:
            packet = self.waiting.popleft()
            if "answer" in packet:
                self.answer(*packet["answer"])
            if "winner" in packet and self.text is not None:
                self.winner.publish(self.text(data=packet["winner"]))
            if "diagnostics" in packet and self.array is not None:
                self.diagnostics.publish(self.diagnosed(packet["diagnostics"]))
            if "params" in packet:
                self.deploy(packet["params"])

    async def stop(self, request: Any, response: Any) -> Any:
        """Stop the robot in an emergency."""
        return await self.call("stop", response)

    async def release(self, request: Any, response: Any) -> Any:
        """Release an emergency stop."""
        return await self.call("release", response)

    async def call(self, service: str, response: Any) -> Any:
        """Have colony answer a call."""
        from rclpy.task import Future

        self.number += 1
        number, future = self.number, Future()
        if len(self.calls) >= MAX_CALLS:
            response.message = f"{MAX_CALLS} calls wait for an answer already"
            return response
        self.calls[number] = future, time.monotonic() + CALL_S
        if not self.report(call=[number, service]):
            self.answer(number, False, "colony takes no calls")
        response.success, response.message = await future
        return response

    def answer(self, number: int, is_done: bool, message: str) -> None:
        """Answer a call, unless it was answered before."""
        future, _ = self.calls.pop(number, (None, 0.0))
        if future is not None:
            future.set_result((is_done, message))

    def check(self) -> None:
        """Answer the calls that colony has not answered."""
        now_s = time.monotonic()
        for number in [number for number, (_, due_s) in self.calls.items() if now_s >= due_s]:
            self.answer(number, False, f"colony did not answer in {CALL_S:g} s")

    def diagnosed(self, rows: Sequence[Any]) -> Any:
        """Return diagnostics: level, name, message and values of each row."""
        status, pair = (
            interface("diagnostic_msgs/msg/DiagnosticStatus"),
            interface("diagnostic_msgs/msg/KeyValue"),
        )
        message = self.array()
        message.header.stamp = self.node.get_clock().now().to_msg()
        for level, name, text, values in rows:
            pairs = [pair(key=key, value=value) for key, value in values.items()]
            message.status.append(status(level=bytes([level]), name=name, message=text, values=pairs))
        return message

    def deploy(self, params: list[list[Any]]) -> None:
        """Replace the params of the program: name, value and meaning of each."""
        if params == self.params:
            return
        descriptor = interface("rcl_interfaces/msg/ParameterDescriptor")
        self.is_deploying = True
        try:
            for name, _, _ in self.params:
                self.node.undeclare_parameter(PREFIX + name)
            self.params = []
            for row in params:
                name, value, meaning = row
                described = descriptor(description=meaning, additional_constraints="set by the deployment")
                self.node.declare_parameter(PREFIX + name, value, described)
                self.params.append(row)
        finally:
            self.is_deploying = False

    def on_set(self, parameters: Sequence[Any]) -> Any:
        """Refuse to change a param of the program."""
        result = interface("rcl_interfaces/msg/SetParametersResult")
        refused = [each.name for each in parameters if each.name.startswith(PREFIX)]
        if self.is_deploying or not refused:
            return result(successful=True)
        reason = f"{refused[0]} is read-only: tune it with `colony params`, or drive with another site"
        return result(successful=False, reason=reason)


def installed(name: str) -> Any:
    """Return an interface, or None if its package is not installed."""
    try:
        return interface(name)
    except ValueError:
        return None
