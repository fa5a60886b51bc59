"""Faults in every kind of device, held against the same run without faults."""

from __future__ import annotations

import re

import pytest

from tests.sim.devices.stage import Stage
from tests.sim.devices.test_devices import BATTERY
from tests.sim.devices.test_second_calculation import WHEELS, WINCH
from tests.sim.devices.test_what_is_seen import SERVERS

SERVERS_WITHOUT_FAULTS = (
    SERVERS[SERVERS.index("[server.Lidar") :]  # the ring of sonars is another test's
    + BATTERY
    + WHEELS
    + WINCH
    + """
[server.Imu.simulated]
device = "imu"
turn   = { noise = "0.1 deg/s", bias = "0.2 deg/s" }

[server.Compass.simulated]
device = "compass"
noise  = "1 deg"

[server.Signals.simulated]
device  = "output"
outputs = { lamp = "level" }

"""
)
FIELDS = [
    ("Lidar", "scan"), ("Edges", "range"), ("Skirt", "bumper"), ("Floor", "cliff"), ("Eye", "dock_distance"),
    ("Battery", "level"), ("Wheels", "travel"), ("Winch", "position"), ("Imu", "turn_rate"),
    ("Imu", "heading"), ("Compass", "heading"), ("Signals", "lamp"),
]  # fmt: skip


def readings(faults: str) -> list[dict[tuple[str, str], tuple[object, int] | None]]:
    """What each field reads, and when it was measured, at the end of each step of 50 ms of a drive."""
    servers = re.sub(
        r"\[server\.(\w+)\.simulated\]", rf"[server.\1]\nfaults = {faults}\n\n\g<0>", SERVERS_WITHOUT_FAULTS
    )
    stage = Stage(servers, walls=[[-1500.0, 2500.0, 1500.0, 2500.0]], docks=[(0.0, 2000.0, 0.0)])
    found = []
    for step in range(700):
        stage.world.command(0, 300.0 if step % 100 < 50 else -300.0, 20.0 if step % 160 < 80 else -20.0)
        if step % 30 == 0:
            now_ns = stage.world.elapsed_ns
            stage.devices[0]["Winch"].command("run", {"velocity": 40.0 if step % 60 else -20.0}, now_ns)
            stage.devices[0]["Signals"].command("set", {"lamp": (step % 7) / 7.0}, now_ns)
        stage.world.advance(0.05)
        samples = {}
        for server, field in FIELDS:
            sample = stage.devices[0][server].sense(stage.world.elapsed_ns)[field]
            samples[server, field] = None if sample is None else (sample.value, sample.t_ns)
        found.append(samples)
    return found


@pytest.fixture(scope="module")
def exact() -> list[dict[tuple[str, str], tuple[object, int] | None]]:
    return readings("{}")


def test_missing_readings_of_each_kind_have_no_value(
    exact: list[dict[tuple[str, str], tuple[object, int] | None]],
) -> None:
    found = readings('{ missing = "30 percent", lasting = "1 s" }')
    for field in FIELDS:
        are_missing = [now[field] is None for now in found]
        assert 0.05 < sum(are_missing) / len(found) < 0.6, field
        for now, free in zip(found, exact, strict=True):
            assert now[field] in (None, free[field]), field


def test_frozen_readings_of_each_kind_are_those_of_the_time_when_they_were_measured(
    exact: list[dict[tuple[str, str], tuple[object, int] | None]],
) -> None:
    found = readings('{ frozen = "30 percent", lasting = "1 s" }')
    for field in FIELDS:
        by_time = {free[field][1]: free[field][0] for free in exact if free[field] is not None}
        ages = []
        for step, now in enumerate(found, 1):
            sample = now[field]
            if sample is not None and sample[1] > 0:
                assert sample[0] == by_time[sample[1]], field
                ages.append(step * 50_000_000 - sample[1])
        assert 0.05 < sum(age > 0 for age in ages) / len(ages) < 0.6, field
        assert 400_000_000 < max(ages) < 4_000_000_000, field
