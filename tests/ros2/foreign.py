"""A robot that knows nothing of colony: rclpy alone, in the environment of `environment.py`.

It drives in a square room, publishes scan and odometry, and takes a twist of either type. Lines of JSON on
standard input change its settings; each twist that it hears is a line on standard output.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import sys
import threading
import time
from functools import partial

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

HALF_M = 3.0
RADIUS_M = 0.2


DEFAULTS = {
    "name": "foreign",
    "rate": 20.0,
    "beams": 360,
    "scan": True,
    "odom": True,
    "frame": "laser",
    "stamp_s": 0.0,  # added to each stamp
    "unstamped": False,
    "twist": "Twist",
    "timeout_s": None,
    "second": None,  # type of a second publisher of cmd_vel
    "command": None,  # velocity and turn that the second publisher sends
    "clock": None,  # rate of a simulated clock, 0 for one that stands still
    "near": False,  # something is 0.3 m away all around
    "others": {},  # topics that it publishes: [type, values, quality]
    "hears": {},  # topics that it hears besides: type, or type and quality
    "call": None,  # a service that it calls once: name, type, request
}


class Robot:
    """The robot; its settings are those of `DEFAULTS`, changed by lines."""

    def __init__(self) -> None:
        self.settings = dict(DEFAULTS)
        self.settings.update(json.loads(sys.argv[1]))
        rclpy.init(args=[])
        self.node = rclpy.create_node(self.settings["name"])
        self.x = self.y = self.yaw = 0.0
        self.velocity = self.turn = 0.0
        self.heard_s = 0.0
        self.sim_s = 1000.0
        self.others: dict = {}
        self.clients: dict = {}
        self.second = None
        self.scans = self.node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self.odoms = self.node.create_publisher(Odometry, "odom", 10)
        self.clocks = None
        self.subscription = None
        self.subscribed = None
        self.apply()
        self.node.create_timer(1.0 / self.settings["rate"], self.step)
        threading.Thread(target=self.read, daemon=True).start()

    def apply(self) -> None:
        kind = self.settings["twist"]
        if kind != self.subscribed:
            if self.subscription is not None:
                self.node.destroy_subscription(self.subscription)
            self.subscription, self.subscribed = None, kind
            if kind == "Twist":
                self.subscription = self.node.create_subscription(Twist, "cmd_vel", self.hear, 10)
            elif kind == "TwistStamped":
                self.subscription = self.node.create_subscription(
                    TwistStamped, "cmd_vel", self.hear_stamped, 10
                )
        second = self.settings["second"]
        if (second is not None) != (self.second is not None):
            if self.second is not None:
                self.node.destroy_publisher(self.second)
                self.second = None
            else:
                self.second = self.node.create_publisher(
                    Twist if second == "Twist" else TwistStamped, "cmd_vel", 10
                )
        if self.settings["clock"] is not None and self.clocks is None:
            self.clocks = self.node.create_publisher(Clock, "/clock", qos_profile_sensor_data)
        for topic, (type_, _, quality) in self.settings["others"].items():
            if topic not in self.others:
                class_ = message_class(type_)
                self.others[topic] = class_, self.node.create_publisher(class_, topic, profile(quality))

        for topic, expected in self.settings["hears"].items():
            if topic not in self.others:
                type_, quality = (expected, "reliable") if isinstance(expected, str) else expected
                class_ = message_class(type_)
                heard = partial(self.hear_other, topic)
                self.others[topic] = class_, None
                self.node.create_subscription(class_, topic, heard, profile(quality, depth=10))
        if self.settings["call"] is not None:
            self.call(*self.settings["call"])
            self.settings["call"] = None

    def call(self, service: str, type_: str, values: dict) -> None:
        """Call a service once it is there; the answer is heard under its name."""
        class_ = message_class(type_)
        client = self.clients.setdefault(service, self.node.create_client(class_, service))
        request = class_.Request()
        fill(request, values)

        def send() -> None:
            if client.service_is_ready():
                timer.cancel()
                future = client.call_async(request)
                future.add_done_callback(lambda done: self.hear_other(service, done.result()))

        timer = self.node.create_timer(0.1, send)

    def hear_other(self, topic: str, message) -> None:
        print(json.dumps({"topic": topic, "data": as_dict(message)}, default=repr), flush=True)

    def read(self) -> None:
        for line in sys.stdin:
            self.settings.update(json.loads(line))
            self.changed = True
        os._exit(0)

    changed = False

    def hear(self, twist: Twist, stamp=None, frame: str = "") -> None:
        now = time.monotonic_ns()
        self.velocity, self.turn, self.heard_s = twist.linear.x, twist.angular.z, now / 1e9
        age = None if stamp is None else time.time() - stamp.sec - stamp.nanosec / 1e9
        row = {
            "t": now,
            "v": self.velocity,
            "w": self.turn,
            "age": age,
            "frame": frame,
            "touched": self.touched,
        }
        print(json.dumps(row), flush=True)

    scan_ns = 0
    near = False
    touched = False

    def hear_stamped(self, message: TwistStamped) -> None:
        self.hear(message.twist, message.header.stamp, message.header.frame_id)

    def stamp(self, header) -> None:
        now = self.sim_s if self.settings["clock"] is not None else time.time()
        now += self.settings["stamp_s"]
        if not self.settings["unstamped"]:
            header.stamp.sec, header.stamp.nanosec = int(now), int(now % 1.0 * 1e9)

    def step(self) -> None:
        if self.changed:
            self.changed = False
            self.apply()
        dt = 1.0 / self.settings["rate"]
        limit = self.settings["timeout_s"]
        if limit is not None and time.monotonic() - self.heard_s > limit:
            self.velocity = self.turn = 0.0
        self.yaw += self.turn * dt
        edge = HALF_M - RADIUS_M
        self.touched = self.touched or max(abs(self.x), abs(self.y)) >= edge
        self.x = max(-edge, min(edge, self.x + self.velocity * math.cos(self.yaw) * dt))
        self.y = max(-edge, min(edge, self.y + self.velocity * math.sin(self.yaw) * dt))
        if self.settings["clock"] is not None:
            self.sim_s += dt * self.settings["clock"]
            clock = Clock()
            clock.clock.sec, clock.clock.nanosec = int(self.sim_s), int(self.sim_s % 1.0 * 1e9)
            self.clocks.publish(clock)
        if self.settings["odom"]:
            odom = Odometry()
            self.stamp(odom.header)
            odom.header.frame_id, odom.child_frame_id = "odom", "base_link"
            odom.pose.pose.position.x, odom.pose.pose.position.y = self.x, self.y
            odom.pose.pose.orientation.z = math.sin(self.yaw / 2)
            odom.pose.pose.orientation.w = math.cos(self.yaw / 2)
            odom.twist.twist.linear.x, odom.twist.twist.angular.z = self.velocity, self.turn
            self.odoms.publish(odom)
        if self.settings["scan"]:
            count = self.settings["beams"]
            scan = LaserScan(angle_increment=2 * math.pi / count, range_min=0.05, range_max=12.0)
            self.stamp(scan.header)
            scan.header.frame_id = self.settings["frame"]
            scan.ranges = [self.distance(self.yaw + 2 * math.pi * i / count) for i in range(count)]
            if self.settings["near"]:
                scan.ranges = [0.3] * count
            self.scan_ns = time.monotonic_ns()
            self.scans.publish(scan)
            if self.settings["near"] != self.near:
                self.near = self.settings["near"]
                print(json.dumps({"near": self.near, "t": self.scan_ns}), flush=True)
        if self.second is not None and self.settings["command"] is not None:
            stamped = TwistStamped()
            self.stamp(stamped.header)
            stamped.twist.linear.x, stamped.twist.angular.z = map(float, self.settings["command"])
            self.second.publish(stamped.twist if self.settings["second"] == "Twist" else stamped)
        for topic, (class_, publisher) in self.others.items():
            if publisher is None or topic not in self.settings["others"]:
                continue
            message = class_()
            fill(message, self.settings["others"][topic][1])
            if hasattr(message, "header"):
                self.stamp(message.header)
            publisher.publish(message)

    def distance(self, angle: float) -> float:
        """Return the way to the wall of the room."""
        ways = []
        for place, along in ((self.x, math.cos(angle)), (self.y, math.sin(angle))):
            if abs(along) > 1e-9:
                ways.append(((HALF_M if along > 0 else -HALF_M) - place) / along)
        return min(ways)


def message_class(type_: str):
    package, kind, name = type_.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def as_dict(message) -> dict:
    fields = message.get_fields_and_field_types()
    values = {name: getattr(message, name) for name in fields}
    return {name: plain(value) for name, value in values.items()}


def plain(value):
    if isinstance(value, list):
        return [plain(each) for each in value]
    return as_dict(value) if hasattr(value, "get_fields_and_field_types") else value


def profile(quality: str, depth: int = 1) -> QoSProfile:
    best, latched = quality == "best_effort", quality == "latched"
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.BEST_EFFORT if best else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def fill(message, values: dict) -> None:
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        elif isinstance(value, list):
            setattr(message, name, [made(each) for each in value])
        else:
            setattr(message, name, value)


def made(value):
    """Return an element of a sequence: a message is its type and its values."""
    if not isinstance(value, list):
        return value
    message = message_class(value[0])()
    fill(message, value[1])
    return message


if __name__ == "__main__":
    robot = Robot()
    print(json.dumps({"ready": True}), flush=True)
    rclpy.spin(robot.node)
