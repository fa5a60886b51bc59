"""What is kept of a device's packets: newest values with their ages, and nothing that is impossible."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.drivers.dialect import ImplausibleError, Readings
from colony.drivers.line import Measurements
from colony.runtime.servers.drivers import BaseState, Reading

STATE = BaseState(
    t_ns=5,
    x=0.0,
    y=0.0,
    heading=0.0,
    front_bumper=False,
    rear_bumper=False,
    speed=100.0,
    turn_rate=0.0,
    wheel_speed=100.0,
)


def measurements() -> Measurements:
    bounds = {"volts": (0.0, 20.0), "sonar": (0.0, 5000.0), "scan": (0.0, 5000.0)}
    return Measurements(rings={"sonar": 3}, bounds=bounds, max_speed=500.0, max_turn=90.0)


def test_a_ring_is_as_old_as_its_oldest_element() -> None:
    found = measurements()
    found.take(Readings(elements={"sonar": {0: 100.0, 1: math.inf}}), 10)
    assert found.readings(20) == {}  # not each element was heard
    found.take(Readings(elements={"sonar": {2: 300.0}}), 15)
    found.take(Readings(elements={"sonar": {0: 110.0}}), 18)
    assert found.readings(20) == {"sonar": Reading((110.0, math.inf, 300.0), 10)}


@pytest.mark.parametrize(
    ("readings", "text"),
    [
        (Readings(fields={"volts": 25.5}), "volts is 25.5; from 0 to 20 is possible"),
        (Readings(fields={"volts": math.nan}), "volts is nan"),
        (Readings(fields={"scan": (100.0, None, math.inf, 6000.0)}), "scan is 6000.0"),
        (Readings(fields={"scan": [6000.0]}), "scan is 6000.0"),  # type: ignore[dict-item]
        (Readings(elements={"sonar": {3: 10.0}}), r"sonar\[3\]: the ring has 3 elements"),
        (Readings(elements={"sonar": {1: 6000.0}}), "sonar is 6000.0"),
        (Readings(base=replace(STATE, speed=501.0)), "the base drives at 501 mm/s; at most 500"),
        (Readings(base=replace(STATE, turn_rate=math.nan)), "the base turns at nan deg/s; at most 90"),
    ],
)
def test_an_impossible_packet_is_refused_as_a_whole(readings: Readings, text: str) -> None:
    found = measurements()
    found.take(Readings(base=STATE, fields={"volts": 12.0}), 5)
    with pytest.raises(ImplausibleError, match=text):
        found.take(replace(readings, fields={"level": 1.0, **readings.fields}), 9)
    assert found.base == STATE
    assert found.readings(10) == {"volts": Reading(12.0, 5)}


def test_nothing_is_left_of_a_lost_line() -> None:
    found = measurements()
    found.take(Readings(base=STATE, fields={"volts": 12.0}), 5)
    found.clear()
    assert found.base is None
    assert found.readings(10) == {}
