"""A robot served with its description: its limits hold for whoever drives, with a program and without."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library import robot
from colony.runtime.library.clock import participants
from colony.runtime.protocol.deployment import LIMITS_RUN
from colony.runtime.transport.live.robot_address import local
from tests.examples.stage import Machine, machine
from tests.waiting import until

pytestmark = pytest.mark.long

SLOW = """
language 1
import robot
module rest { when true  do drive(velocity = 0, turn = 0) }
network { drive = rest }
limit drive.velocity <= 40 mm/s
"""


@pytest.fixture
def rome(tmp_path: Path) -> Iterator[Machine]:
    (tmp_path / "slow.colony").write_text(SLOW, encoding="utf-8")
    with machine(tmp_path) as on:
        on.start("colony serve all --robot lab=rome --map loop")
        on.there("lab", "Clock", "RServer", "PServer")
        yield on


def reports(base: Connection) -> bool:
    """Return whether the base has reported its state: its simulator may start after its server."""
    try:
        base.do(robot.wheel_speed())
    except CallRefusedError:
        return False
    return True


def test_the_limits_hold_without_a_program_and_again_after_one(rome: Machine) -> None:
    with Session.open("lab", environment=rome.environment) as session:
        stick = session.connect("RServer", name="stick", priority=50)
        until(lambda: reports(stick), "the base reports its state")

        def drives(velocity: float) -> float:
            stick.do(robot.drive(velocity, 0.0, lease=1.0))
            return stick.do(robot.speed_setting())

        until(lambda: drives(200.0) > 0.0, "the limits are deployed, and it drives")
        assert re.search(r"no program runs, but the limits of rome hold", rome.run("colony ps").printed())
        fastest = 0.0

        def at_the_wall() -> bool:
            nonlocal fastest
            fastest = max(fastest, drives(600.0))
            return fastest > 150.0 and drives(600.0) < 20.0

        until(at_the_wall, "the limits slow it down at the wall")
        with rome.plant("lab") as plant:
            assert plant.truth("lab").bumps == 0
        until(lambda: drives(-300.0) < -100.0, "it drives back")
        run = rome.start("colony drive slow.colony --robot lab=rome")
        ticks = session.connect("Clock")
        until(lambda: (p := ticks.do(participants())).begun and p.run != LIMITS_RUN, "the run begins")
        until(lambda: 0.0 < drives(300.0) <= 40.0, "the program's limits hold")
        for _ in range(20):
            assert drives(300.0) <= 40.0
        assert run.finish() in (0, 130)
        until(lambda: drives(300.0) > 40.0, "those of the description hold alone again")
        assert rome.run("colony stop --robot lab").result() == 0
        until(lambda: stick.do(robot.speed_setting()) == 0.0, "it stands")
        assert rome.run("colony stop --robot lab --release").result() == 0
        until(lambda: drives(200.0) > 0.0, "it drives again")
        os.kill(local("lab", rome.environment).directory.running()["RServer"], signal.SIGKILL)
        rome.there("lab", "Clock", "RServer")
        assert stick.do(robot.speed_setting()) <= 600.0


def test_servers_that_are_served_alone_need_the_limits(tmp_path: Path) -> None:
    with machine(tmp_path) as on:
        on.start("colony serve Simulator --robot lab=rome --map loop").says("runs")
        for name in ("Clock", "RServer", "PServer", "DServer"):
            on.start(f"colony serve {name} --robot lab=rome")
        on.there("lab", "Clock", "RServer", "PServer", "DServer")
        with Session.open("lab", environment=on.environment) as session:
            stick = session.connect("RServer", name="stick", priority=50)
            until(lambda: reports(stick), "the base reports its state")

            def drives() -> float:
                stick.do(robot.drive(100.0, 0.0, lease=1.0))
                return stick.do(robot.speed_setting())

            def stands() -> bool:
                for _ in range(20):
                    assert drives() == 0.0
                return "LOST: drive/.bounds, so nobody drives" in on.run("colony ps --robot lab").printed()

            until(stands, "nobody drives")
            limits = on.start("colony serve Limits --robot lab=rome")
            until(lambda: drives() == 100.0, "it drives within the limits")
            limits.kill()
            until(lambda: drives() == 0.0, "it stands")
            assert stands()
