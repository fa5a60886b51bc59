"""Faults of devices: how often, for how long, and what is read meanwhile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import pytest

from colony.body.model import DeviceFaults
from colony.body.reader import body_of_text
from colony.runtime.servers.drivers import Drivers
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.config import config_of, without_errors
from colony.sim.devices.device import Fault, FaultTimeline
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.world.world import World
from tests.sim.devices.stage import CHASSIS, Stage

STEP_NS = 50_000_000
IMU = '[server.Imu]\nfaults = {faults}\nsimulated = {{ device = "imu" }}\n'
RING = """
[server.PServer.simulated]
device   = "proximity"
count    = 8
bearing  = "0 deg"
ring     = "200 mm"
sonar    = { range = "5 m", half_beam = "12 deg", critical = "30 deg" }
infrared = { range = "1 m" }
"""
MISSING = '{ missing = "30 percent", lasting = "2 s" }'
FROZEN = '{ frozen = "30 percent", lasting = "2 s" }'


def timeline(missing: float, frozen: float, seed: int, hours: float = 2.0) -> list[Fault | None]:
    """The faults of a device at the end of each step of a tenth of a second."""
    faults = FaultTimeline(DeviceFaults(missing=missing, frozen=frozen, lasting_s=2.0), seed)
    return [faults.at(i * 100_000_000) for i in range(round(hours * 36_000))]


@pytest.mark.parametrize(("missing", "frozen"), [(0.1, 0.05), (0.0, 0.4), (0.6, 0.0), (0.01, 0.005)])
def test_faults_take_their_parts_of_the_time(missing: float, frozen: float) -> None:
    found = [fault for seed in range(4) for fault in timeline(missing, frozen, seed)]
    for fault, part in ((Fault.MISSING, missing), (Fault.FROZEN, frozen)):
        episodes = len(found) * 0.1 * (missing + frozen) / 2.0
        assert found.count(fault) / len(found) == pytest.approx(part, abs=5.0 * part / math.sqrt(episodes))


def test_faults_last_about_as_long_as_they_should() -> None:
    runs = [(fault, len(list(group)) / 10.0) for fault, group in groupby(timeline(0.1, 0.05, 5))]
    lengths = np.array([seconds for fault, seconds in runs[:-1] if fault is not None])
    assert len(lengths) > 300
    assert lengths.mean() == pytest.approx(2.0, abs=0.15)
    assert (lengths >= 0.9).all()
    assert (lengths <= 3.1).mean() > 0.9  # the others are two, one right after the other


def test_faults_depend_on_the_seed_and_the_time_alone() -> None:
    assert timeline(0.1, 0.1, 3, 0.1) == timeline(0.1, 0.1, 3, 0.1) != timeline(0.1, 0.1, 4, 0.1)
    once = FaultTimeline(DeviceFaults(missing=0.1, frozen=0.1, lasting_s=2.0), 3)
    assert once.at(3500 * 100_000_000) == timeline(0.1, 0.1, 3, 0.1)[3500]


@dataclass
class Seen:
    """What was read at the end of each step: values and ages in steps; None for those that were missing."""

    values: list[object]
    ages: list[int | None]


def seen(faults: str, seed: int = 1, steps: int = 1200, every: int = 1) -> Seen:
    """The turn rate of a robot that turns ever faster, then slower, so that no two readings are equal."""
    stage = Stage(IMU.format(faults=faults), seed=seed)
    found = Seen([], [])
    for step in range(1, steps + 1):
        stage.world.command(0, 0.0, 90.0 * step / steps)
        stage.world.advance(STEP_NS / 1e9)
        if step % every == 0:
            taken = stage.time_of("Imu", "turn_rate")
            found.values.append(stage.read("Imu", "turn_rate"))
            found.ages.append(None if taken is None else round((stage.world.elapsed_ns - taken) / STEP_NS))
    return found


def test_when_a_device_fails_does_not_depend_on_when_it_is_read() -> None:
    often, seldom = seen(FROZEN), seen(FROZEN, every=40)
    assert seldom.values == often.values[39::40]
    assert seldom.ages == often.ages[39::40]
    assert seen(FROZEN, seed=2).ages != often.ages


def test_each_device_and_robot_fails_on_its_own() -> None:
    two = IMU.format(faults=MISSING) + IMU.format(faults=MISSING).replace("[server.Imu]", "[server.Other]")
    stage = Stage(two, poses=[(0.0, 0.0, 0.0), (5000.0, 0.0, 0.0)])
    found = []
    for _ in range(400):
        stage.world.advance(0.1)
        names = (("Imu", 0), ("Imu", 1), ("Other", 0))
        found.append(tuple(stage.read(name, "heading", robot) is None for name, robot in names))
    first, second, third = zip(*found, strict=True)
    assert len({first, second, third}) == 3


def drivers(servers: str, base: str = "") -> tuple[Drivers, VirtualClock]:
    text = CHASSIS.replace("[server.RServer]\n", f"[server.RServer]\n{base}")
    file = body_of_text(text + servers, "probe.toml")
    assert file.body is not None, file.diagnostics
    clock = VirtualClock(7)
    world = World(walls=[], poses=[(0.0, 0.0, 0.0)], config=config_of(file.body))
    return simulated_drivers(Plant(world, clock), body=file.body), clock


def test_base_and_ring_fail_too() -> None:
    ring = f"[server.PServer]\nfaults = {MISSING}\n" + RING
    robot, clock = drivers(ring, f"faults = {FROZEN}\n")
    assert robot.base is not None
    assert robot.proximity is not None
    ages, sonars, infrared = [], [], []
    for _ in range(1200):
        clock.now_ns += STEP_NS
        state = robot.base.state()
        ages.append(clock.now_ns - state.t_ns)
        sonars.append(robot.proximity.sonar() is None)
        infrared.append(robot.proximity.infrared() is None)
    assert 0.1 < sum(age > 0 for age in ages) / len(ages) < 0.5
    assert 1_000_000_000 < max(ages) < 7_000_000_000
    assert sonars == infrared
    assert 0.1 < sum(sonars) / len(sonars) < 0.5


def test_a_robot_without_errors_has_no_faults() -> None:
    text = CHASSIS.replace("[server.RServer]\n", f"[server.RServer]\nfaults = {MISSING}\n")
    body = body_of_text(text, "probe.toml").body
    assert body is not None
    config = config_of(body)
    assert config.base_faults is not None
    assert without_errors(config).base_faults is None
