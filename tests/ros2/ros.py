"""What tests with a genuine ROS 2 have: a network of their own, the foreign robot in it, and drivers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from colony.ros2.connection import NodeSettings, Ros2Connection
from tests.paths import ROOT
from tests.ros2.environment import existing
from tests.waiting import until

_domains = count(os.getpid())

ODOM = {"topic": "odom", "type": "nav_msgs/msg/Odometry"}
SCAN = {
    "topic": "scan",
    "type": "sensor_msgs/msg/LaserScan",
    "frame": "laser",
    "bearings_deg": [0, 90, -180, -90],
    "spacing_deg": 90,
}
DRIVE = {"topic": "cmd_vel", "type": "auto"}


class Ros:
    """A network with only a loopback, in which nodes of a domain of their own find each other. Mutable."""

    def __init__(self, folder: Path) -> None:
        made = existing()
        if made is None:
            pytest.skip("there is no ROS 2 environment: `python -m tests.ros2.environment` makes it")
        self._stack = ExitStack()
        self.domain = next(_domains) % 100 + 1
        self.holder = self._process(
            ["unshare", "-rn", "sh", "-c", "ip link set lo up multicast on && echo up && exec sleep 100000"],
            stdout=subprocess.PIPE,
        )
        assert self.holder.stdout is not None
        if self.holder.stdout.readline() != b"up\n":
            pytest.skip("`unshare -rn` makes no network here")
        self.python = folder / "ros-python"
        enter = f"nsenter -t {self.holder.pid} -U -n --preserve-credentials"
        self.python.write_text(
            "#!/bin/sh\nexport ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST PYTHONUNBUFFERED=1\n"
            f'export ROS_DOMAIN_ID={self.domain}\nexec {enter} {made} "$@"\n'
        )
        self.python.chmod(0o700)

    def _process(self, command: list[Any], **options: Any) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(command, **options)
        self._stack.callback(_end, process)
        return process

    def foreign(self, **settings: Any) -> Foreign:
        """Return a foreign robot that has started."""
        command = [self.python, ROOT / "tests" / "ros2" / "foreign.py", json.dumps(settings)]
        process = self._process(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        robot = Foreign(process)
        until(lambda: robot.is_ready, "the foreign robot is ready", patience_s=60.0)
        return robot

    def walker(self, **settings: Any) -> Walker:
        """Return an action server that has started."""
        command = [self.python, ROOT / "tests" / "ros2" / "walker.py", json.dumps(settings)]
        walker = Walker(self._process(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
        until(lambda: walker.said("ready"), "the action server is ready", patience_s=60.0)
        return walker

    def node(self, **settings: Any) -> str:
        """Return the settings of a node, as drivers get them."""
        return json.dumps({"name": "colony", "python": str(self.python), **settings})

    def connection(self, report: Callable[[str], None], **settings: Any) -> Ros2Connection:
        """Return a connection of this process alone."""
        found = Ros2Connection.shared(NodeSettings(**json.loads(self.node(**settings))), report)
        self._stack.callback(found.close)
        return found

    def driver_process(self, *, alone: bool = False) -> subprocess.Popen[bytes]:
        """Start a process that drives the base at 0.2 m/s."""
        topics = json.dumps({"in": {"odom": ODOM}, "out": {"drive": {**DRIVE, "alone": alone}}})
        return self._process([sys.executable, "-c", DRIVER, self.node(), topics], cwd=ROOT)

    def walker_process(self) -> subprocess.Popen[bytes]:
        """Start a process that decides the goal 5 of the walker."""
        return self._process([sys.executable, "-c", WALKER, self.node(), json.dumps(WALKING)], cwd=ROOT)

    def close(self) -> None:
        """End all processes."""
        self._stack.close()


WALK = {"topic": "walk", "type": "test_msgs/action/Fibonacci"}
STATES = ("idle", "sent", "executing", "succeeded", "canceled", "aborted", "rejected", "lost")
WALKING: dict[str, Any] = {
    "in": {
        "state": {**WALK, "path": "status", "members": {name: float(i) for i, name in enumerate(STATES)}},
        "order": {**WALK, "path": "sequence[0]"},
        "step": {**WALK, "path": "sequence[1]"},
    },
    "out": {"walk": {**WALK, "parameters": {"order": "order"}}},
}
"""The topics of a server whose command is the action of the walker."""

WALKER = """
import sys, time
from contextlib import suppress
from colony.ros2.drivers import Ros2Device
device = Ros2Device(*sys.argv[1:])
while True:
    time.sleep(0.05)
    with suppress(ConnectionError):
        device.command("walk", {"order": 5.0})
"""

DRIVER = """
import sys, time
from contextlib import suppress
from colony.ros2.drivers import Ros2Base
base = Ros2Base(*sys.argv[1:])
while True:
    time.sleep(0.05)
    with suppress(ConnectionError):
        base.drive(200.0, 0.0)
"""


class Foreign:
    """A foreign robot. Mutable: what it has heard.

    `heard` are its twists, `others` the messages of other topics by name, `near` the times at which it began
    to publish that something is near, or no more.
    """

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self.is_ready = False
        self.heard: list[dict[str, Any]] = []
        self.others: dict[str, list[dict[str, Any]]] = {}
        self.near: list[tuple[bool, int]] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            row = json.loads(line)
            if "topic" in row:
                self.others.setdefault(row["topic"], []).append(row["data"])
            elif "ready" in row:
                self.is_ready = True
            elif "near" in row:
                self.near.append((row["near"], row["t"]))
            else:
                self.heard.append(row)

    def set(self, **settings: Any) -> None:
        """Change its settings."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(settings).encode() + b"\n")
        self.process.stdin.flush()

    def drives(self) -> bool:
        """Return True if it was just told to move."""
        return bool(self.heard) and self.heard[-1]["v"] > 0 and _age_s(self.heard[-1]) < 0.2

    def since(self, t_ns: int) -> list[dict[str, Any]]:
        """Return what it heard since a time of the monotonic clock."""
        return [row for row in list(self.heard) if row["t"] >= t_ns]

    def stands(self) -> bool:
        """Return True if the last ten twists were zero, and none came for a while."""
        last = self.heard[-10:]
        return len(last) == 10 and not any(r["v"] or r["w"] for r in last) and _age_s(last[-1]) > 0.5


class Walker:
    """An action server. Mutable: the rows that it has written."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self.rows: list[dict[str, Any]] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.rows.append(json.loads(line))

    def set(self, **settings: Any) -> None:
        """Change its settings."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(settings).encode() + b"\n")
        self.process.stdin.flush()

    def said(self, key: str) -> list[Any]:
        """Return what it has written under a key: `asked`, `began` or `ended`."""
        return [row[key] for row in list(self.rows) if key in row]

    def end(self, order: int) -> str | None:
        """Return how the last goal of this order ended, if it did."""
        states = [row["state"] for row in list(self.rows) if row.get("ended") == order]
        return states[-1] if states else None


def freeze(pid: int) -> None:
    """Freeze a process, and wait until all its threads stand."""
    os.kill(pid, signal.SIGSTOP)
    tasks = Path(f"/proc/{pid}/task")
    until(lambda: all(_state(task) == "T" for task in tasks.iterdir()), "it is frozen")


def _state(task: Path) -> str:
    return (task / "stat").read_text().rpartition(")")[2].split()[0]


def _age_s(row: dict[str, Any]) -> float:
    return time.monotonic() - row["t"] / 1e9


def _end(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        process.send_signal(signal.SIGCONT)
        process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with suppress(OSError):
                stream.close()
