"""The calls of RServer over a simulated base, which follows slowly and meets walls."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from colony.runtime.library import robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.messages import Reply
from colony.runtime.servers.drivers import BaseState
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.config import RobotConfig
from colony.sim.drivers import Plant, SimulatedBase
from colony.sim.world.world import World
from tests.kit.base import Stage
from tests.sim.robots import IDEAL, ROME

WALLS = [[-60_000.0, 4000.0, 5000.0, 4000.0]]


class Rolling(SimulatedBase):
    """A base whose clock the stage turns.

    Its controller may keep x and y in signed registers of so many bits, in whole mm, which overflow as the
    Labmate's do (thesis section 4.6.3, "Virtual X-Y Coordinate").
    """

    def __init__(
        self,
        config: RobotConfig = IDEAL,
        bits: int | None = None,
        pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.clock = VirtualClock()
        self.world = World(walls=WALLS, poses=[pose], config=config, seed=3)
        super().__init__(Plant(self.world, self.clock), 0)
        self.register_bits = bits

    def roll(self, now_ns: int) -> None:
        self.clock.now_ns = now_ns

    def state(self) -> BaseState:
        state = super().state()
        if self.register_bits is None:
            return state
        half = 1 << (self.register_bits - 1)
        x, y = (float((round(value) + half) % (2 * half) - half) for value in (state.x, state.y))
        return replace(state, x=x, y=y)


def stage(config: RobotConfig = IDEAL, bits: int | None = None) -> tuple[Stage, World]:
    base = Rolling(config, bits)
    found = Stage(base)  # type: ignore[arg-type]
    found.open("ann/1")
    return found, base.world


def done(one: Stage, ask: CallRequest[Any]) -> Reply:
    number = one.send("ann/1", ask)
    reply = one.frames_until("ann/1", number)
    one.frame(count=5)
    return reply


def test_a_square_ends_where_it_began() -> None:
    one, world = stage()
    for _ in range(4):
        assert done(one, robot.move(800.0, 400.0)).problem is None
        assert done(one, robot.turn(90.0)).problem is None
    pose = world.true_pose(0)
    assert (pose.x_mm, pose.y_mm) == pytest.approx((0.0, 0.0), abs=12.0)
    assert math.remainder(pose.heading_deg, 360.0) == pytest.approx(0.0, abs=1.5)


def test_what_wheels_report_wrongly_does_not_keep_it_from_its_way() -> None:
    one, world = stage(ROME)
    assert done(one, robot.move(3000.0, 500.0)).problem is None
    odometry = world.odometry(0)
    assert odometry.y_mm == pytest.approx(3000.0, abs=5.0)
    assert abs(odometry.x_mm) < 30.0


def test_an_arc_goes_round_its_center() -> None:
    one, world = stage()
    assert done(one, robot.continuous_turn(-180.0, 600.0, 200.0)).problem is None
    pose = world.true_pose(0)
    assert (pose.x_mm, pose.y_mm) == pytest.approx((-1200.0, 0.0), abs=25.0)


def test_a_wall_ends_a_motion() -> None:
    one, world = stage()
    reply = done(one, robot.move(10_000.0, 600.0))
    assert reply.problem.code == "bumper"
    assert world.true_pose(0).y_mm == pytest.approx(3600.0, abs=2.0)
    assert done(one, robot.move(-500.0)).problem is None


def test_it_goes_on_beyond_its_registers() -> None:
    one, world = stage(bits=16)
    one.do("ann/1", robot.set_position(0.0, 0.0, 90.0))
    one.do("ann/1", robot.set_position(0.0, 0.0, 0.0))
    assert done(one, robot.turn(-90.0)).problem is None
    assert done(one, robot.move(33_500.0, 600.0)).problem is None
    state = world.odometry(0)
    assert state.x_mm < -33_400.0
    where = one.do("ann/1", robot.position())
    assert (where.x, where.y) == pytest.approx((state.x_mm, state.y_mm), abs=2.0)


def test_registers_overflow_in_both_directions() -> None:
    state = Rolling(bits=16, pose=(-32_800.0, 32_900.4, 0.0)).state()
    assert (state.x, state.y) == (65_536.0 - 32_800.0, 32_900.0 - 65_536.0)
