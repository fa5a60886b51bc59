"""Scans of any kind as arrays of an interface, held to a second reading by rosbags and numpy."""

from __future__ import annotations

import math
import random
from functools import cache
from typing import Any

import pytest

from colony.ir.ros2_messages import LASER_SCAN, STANDARD
from colony.ros2.cdr import decode, encode, structure
from colony.ros2.scan import Mounting, ScanReader, UnusableError, distance

KIND = structure(LASER_SCAN, STANDARD)
ODD = [math.nan, math.inf, -math.inf, 0.0, 0.01, 0.1, 12.0, 12.5, -1.0]


def scan(
    ranges: list[float], first: float, step: float, low: float = 0.1, high: float = 12.0
) -> dict[str, Any]:
    """Return a scan as it is read."""
    values = {
        "angle_min": first,
        "angle_increment": step,
        "range_min": low,
        "range_max": high,
        "ranges": ranges,
    }
    return decode(KIND, encode(KIND, values))


def read(message: dict[str, Any], degrees: list[float], spacing: float = 1.0, **mounting: Any) -> Any:
    """Return the elements along bearings."""
    reader = ScanReader([math.radians(d) for d in degrees], math.radians(spacing), Mounting(**mounting))
    return reader.read(message)


@pytest.mark.parametrize(
    ("value", "expected", "zero_expected"),
    [
        (1.0, 1.0, 1.0),
        (0.1, 0.1, 0.1),
        (12.0, 12.0, 12.0),
        (math.inf, math.inf, math.inf),
        (-math.inf, 0.0, 0.0),
        (math.nan, None, None),
        (0.09, None, None),
        (12.1, None, None),
        (-1.0, None, None),
        (0.0, None, math.inf),
    ],
)
def test_a_range_means_what_rep_117_says(
    value: float, expected: float | None, zero_expected: float | None
) -> None:
    assert distance(value, 0.1, 12.0) == expected
    assert distance(value, 0.1, 12.0, is_zero_no_echo=True) == zero_expected
    for is_zero, wanted in ((False, expected), (True, zero_expected)):
        message = scan([value], 0.0, 0.0, float(_single(0.1)))
        (found,) = read(message, [0.0], is_zero_no_echo=is_zero)
        assert found == (wanted if wanted is None else _single(wanted))


def _single(value: float) -> float:
    import struct

    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def test_a_device_that_measures_down_to_0_has_that_range_unless_it_is_no_echo() -> None:
    assert read(scan([0.0], 0.0, 0.0, low=0.0), [0.0]) == (0.0,)
    assert read(scan([0.0], 0.0, 0.0, low=0.0), [0.0], is_zero_no_echo=True) == (math.inf,)


@pytest.mark.parametrize(
    ("first", "step", "count", "mounting", "expected"),
    [
        (0.0, 90.0, 4, {}, (1.0, 2.0, 3.0, 4.0)),
        (-180.0, 90.0, 4, {}, (3.0, 4.0, 1.0, 2.0)),
        (-180.0, 90.0, 5, {}, (3.0, 4.0, 1.0, 2.0)),  # the last beam looks where the first one does
        (180.0, -90.0, 4, {}, (3.0, 2.0, 1.0, 4.0)),
        (0.0, 90.0, 4, {"bearing_rad": math.pi}, (3.0, 4.0, 1.0, 2.0)),
        (0.0, 90.0, 4, {"is_upside_down": True}, (1.0, 4.0, 3.0, 2.0)),
        (0.0, 90.0, 4, {"is_upside_down": True, "bearing_rad": math.pi / 2}, (2.0, 1.0, 4.0, 3.0)),
        (-45.0, 45.0, 3, {}, (2.0, None, None, None)),
        (0.0, 0.0, 1, {}, (1.0, None, None, None)),
        (0.0, 90.0, 0, {}, (None, None, None, None)),
        (350.0, 20.0, 2, {}, (1.0, None, None, None)),
    ],
)
def test_an_element_takes_the_nearest_beam_along_its_bearing(
    first: float, step: float, count: int, mounting: dict[str, Any], expected: tuple[float | None, ...]
) -> None:
    message = scan([float(i + 1) for i in range(count)], math.radians(first), math.radians(step))
    assert read(message, [0.0, 90.0, 180.0, -90.0], 90.0, **mounting) == expected


def test_a_scan_with_another_number_of_beams_is_read_by_its_own_angles() -> None:
    reader = ScanReader([0.0], 0.1, Mounting())
    assert reader.read(scan([1.0, 2.0, 3.0], -0.1, 0.1)) == (2.0,)
    assert reader.read(scan([1.0, 2.0, 3.0, 4.0, 5.0], -0.2, 0.1)) == (3.0,)
    assert reader.read(scan([1.0, 2.0, 3.0], 0.0, 0.1)) == (1.0,)


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (scan([1.0] * 3, 0.0, 0.0), "3 beams, and an `angle_increment` of 0"),
        (scan([1.0] * 3, math.nan, 0.1), "angles from nan"),
        (scan([1.0] * 3, 0.0, math.inf), "angles from 0 by inf"),
        (scan([1.0] * 100, 0.0, 1.0), "more than 2 turns"),
        (scan([1.0], 0.0, 0.1, high=0.0), "ranges from 0.1 to 0 m"),
        (scan([1.0], 0.0, 0.1, high=math.nan), "ranges from 0.1 to nan m"),
    ],
)
def test_a_scan_without_usable_angles_is_refused(message: dict[str, Any], why: str) -> None:
    with pytest.raises(UnusableError, match=why):
        read(message, [0.0])


# --- a second reading -----------------------------------------------------------------------------


def drawn(chance: random.Random) -> tuple[dict[str, Any], list[float], float, dict[str, Any]]:
    """Return a scan, bearings in degrees, the angle between them, and a mounting."""
    count = chance.choice([0, 1, 2, 90, 180, 359, 360, 361, 541, 720, chance.randint(1, 800)])
    turn = chance.choice([90.0, 180.0, 270.0, 360.0])
    step = math.radians(turn / max(count - chance.choice([0, 1]), 1)) * chance.choice([1, 1, -1])
    first = math.radians(chance.choice([-180.0, -135.0, 0.0, 180.0, chance.uniform(-400, 400)]))
    low, high = chance.choice([(0.0, 12.0), (0.1, 12.0), (0.12, 3.5)])
    odd = chance.choice([0.0, 0.1, 1.0])
    ranges = [chance.choice(ODD) if chance.random() < odd else chance.uniform(0, 13) for _ in range(count)]
    values = {
        "angle_min": first,
        "angle_increment": step,
        "range_min": low,
        "range_max": high,
        "ranges": ranges,
    }
    if chance.random() < 0.3:
        values["intensities"] = ranges
    size = chance.choice([1, 24, 72, 360, chance.randint(1, 400)])
    spacing = 360.0 / size
    start = chance.choice([0.0, -180.0, chance.uniform(-180, 180)])
    degrees = [(start + i * spacing + 180.0) % 360.0 - 180.0 for i in range(size)]
    mounting = {
        "bearing_rad": math.radians(chance.choice([0.0, 180.0, chance.uniform(-180, 180)])),
        "is_upside_down": chance.random() < 0.3,
        "is_zero_no_echo": chance.random() < 0.3,
    }
    return values, degrees, spacing, mounting


@cache
def typestore() -> Any:
    """Return the types of rosbags, which take a while to make."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def second_reading(
    data: bytes, degrees: list[float], spacing: float, mounting: dict[str, Any]
) -> list[set[Any]]:
    """Return what each element may be, by rosbags and numpy: of beams that are equally near, any."""
    import numpy as np

    message: Any = typestore().deserialize_cdr(data, LASER_SCAN)
    ranges = np.asarray(message.ranges, dtype=np.float64)
    low, high = float(message.range_min), float(message.range_max)
    sign = -1.0 if mounting["is_upside_down"] else 1.0
    beams = mounting["bearing_rad"] + sign * (
        float(message.angle_min) + np.arange(len(ranges)) * float(message.angle_increment)
    )
    reach = abs(float(message.angle_increment)) / 2 or math.radians(spacing) / 2
    values: list[Any] = [None] * len(ranges)
    for i, value in enumerate(ranges):
        if low <= value <= high and value >= 0:
            values[i] = float(value)
        if value == 0 and mounting["is_zero_no_echo"]:
            values[i] = math.inf
        if np.isposinf(value):
            values[i] = math.inf
        if np.isneginf(value):
            values[i] = 0.0
    found: list[set[Any]] = []
    for angle in np.radians(degrees):
        away = np.abs((beams - angle + np.pi) % (2 * np.pi) - np.pi)
        nearest = away.min() if len(away) else math.inf
        may = {values[i] for i in np.flatnonzero(away <= nearest + 2e-5) if away[i] <= reach + 2e-5}
        if nearest > reach:
            may.add(None)
        found.append(may)
    return found


def check_drawn(seed: object) -> None:
    chance = random.Random(f"scan {seed}")
    values, degrees, spacing, mounting = drawn(chance)
    data = encode(KIND, values, order=chance.choice("<<>"))
    try:
        found = read(decode(KIND, data), degrees, spacing, **mounting)
    except UnusableError:
        assert len(values["ranges"]) > 1, values
        assert values["angle_increment"] == 0.0, values
        return
    little = encode(KIND, values)
    for i, may in enumerate(second_reading(little, degrees, spacing, mounting)):
        assert found[i] in may, (seed, i, degrees[i], found[i], may)


def test_drawn_scans_are_read_as_by_numpy() -> None:
    pytest.importorskip("rosbags")
    for seed in range(300):
        check_drawn(seed)


@pytest.mark.thorough
def test_many_drawn_scans_are_read_as_by_numpy() -> None:
    pytest.importorskip("rosbags")
    for seed in range(10_000):
        check_drawn(seed)
