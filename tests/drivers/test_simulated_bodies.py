"""Robots as their descriptions simulate them, beside their emulators behind the real drivers.

Both get the same commands in the same room, and are compared in what a program reads of them. The simulated
base has no errors of its own here. docs/pioneer.md and docs/create2.md have the bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from colony.body.model import Body
from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.drivers.create2.create2 import Create2
from colony.drivers.create2.firmware import Create2Firmware as CreateFirmware
from colony.drivers.create2.firmware import EmulatedWorld as CreateWorld
from colony.drivers.dialect import OpeningError
from colony.drivers.emulator import Surroundings, room
from colony.drivers.pioneer.firmware import PioneerFirmware as PioneerFirmware
from colony.drivers.pioneer.parameters import MODELS
from colony.drivers.pioneer.pioneer import Pioneer
from colony.runtime.servers.drivers import BaseState
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.config import config_of, without_errors
from colony.sim.drivers import Plant, simulated_drivers
from colony.sim.world.world import World
from tests.drivers.bench import Bench

FRAME_S = 0.05
WIDTH_MM, DEPTH_MM = 4000.0, 6000.0
ROOM: Surroundings = room(WIDTH_MM, DEPTH_MM)

TOUR = (
    (4.0, 250.0, 0.0),
    (4.0, 150.0, 30.0),
    (2.0, 0.0, -60.0),
    (6.0, 200.0, -20.0),
    (3.0, -100.0, 0.0),
    (4.0, 0.0, 45.0),
    (4.0, 250.0, 10.0),
)
"""Seconds, mm/s and deg/s; the robot rests after each."""

REST_S = 1.5


class Simulated:
    """A body in the simulator, without errors of its base. Mutable: its time goes on."""

    def __init__(self, name: str, *, holes: Sequence[Any] = (), heading: float = 0.0) -> None:
        self.body: Body = shipped_body(name)
        w, d = WIDTH_MM / 2.0, DEPTH_MM / 2.0
        walls = np.array([(-w, -d, -w, d), (-w, d, w, d), (w, d, w, -d), (w, -d, -w, -d)])
        config = without_errors(config_of(self.body))
        self.world = World(walls=walls, poses=[(0.0, 0.0, heading)], config=config, holes=holes)
        self._clock = VirtualClock()
        self._plant = Plant(self.world, self._clock)
        self.drivers = simulated_drivers(self._plant, body=self.body, servers=servers_of(self.body), seed=1)
        self.run(0.5, (0.0, 0.0))

    def run(self, seconds: float, drive: tuple[float, float]) -> None:
        """Let time pass, with a command in each frame."""
        assert self.drivers.base is not None
        for _ in range(round(seconds / FRAME_S)):
            self.drivers.base.drive(*drive)
            self._clock.now_ns += round(FRAME_S * 1e9)
            self._plant.catch_up()

    @property
    def base(self) -> BaseState:
        """What its base says."""
        state = self.drivers.base.state()
        assert state is not None
        return state

    def read(self, server: str, field: str) -> tuple[float, ...]:
        """Return what a device says."""
        reading = self.drivers.devices[server].fields()[field]
        return as_ranges(reading.value)


def emulated_pioneer() -> Bench[bytes]:
    """Return a Pioneer behind its driver, set as its body says."""
    server = shipped_body("pioneer").servers["RServer"]
    options: dict[str, Any] = {
        name: value for name, value in server.hardware.options.items() if name != "port"
    }
    line = Bench(Pioneer(**options), PioneerFirmware(MODELS["p3dx-sh"], around=ROOM, bumpers=5))
    line.open(4.0)
    return line


def emulated_create(heading: float = 0.0) -> Bench[Any]:
    """Return a Create 2 behind its driver."""
    robot = CreateFirmware(CreateWorld(range=ROOM))
    robot.pose = (0.0, 0.0, heading)
    line = Bench(Create2(), robot)
    line.open(1.5)
    return line


def drive_both(
    simulated: Simulated, emulated: Bench[Any], seconds: float, drive: tuple[float, float]
) -> None:
    """Give both the same commands."""
    simulated.run(seconds, drive)
    emulated.run(seconds, drive)


def apart(one: BaseState, other: BaseState) -> tuple[float, float, float, float]:
    """Return how far two bases are apart: mm, degrees, mm/s and deg/s."""
    return (
        math.hypot(one.x - other.x, one.y - other.y),
        abs(math.remainder(one.heading - other.heading, 360.0)),
        abs(one.speed - other.speed),
        abs(one.turn_rate - other.turn_rate),
    )


def toured(
    simulated: Simulated, emulated: Bench[Any], ring: tuple[str, str, str], reach: float
) -> Mapping[str, float]:
    """Drive both along the tour; return the worst differences where they rest, and of their speeds."""
    worst = dict.fromkeys(("mm", "deg", "mm/s", "deg/s", "range"), 0.0)
    server, field, name = ring
    for seconds, velocity, turn in TOUR:
        drive_both(simulated, emulated, seconds, (velocity, turn))
        _, _, speed, rate = apart(simulated.base, emulated.base)
        drive_both(simulated, emulated, REST_S, (0.0, 0.0))
        place, heading, _, _ = apart(simulated.base, emulated.base)
        seen = as_ranges(emulated.measured.readings(emulated.now_ns)[name].value)
        pairs = zip(simulated.read(server, field), seen, strict=True)
        ranges = [abs(min(a, reach) - min(b, reach)) for a, b in pairs]
        found = {"mm": place, "deg": heading, "mm/s": speed, "deg/s": rate, "range": max(ranges)}
        worst = {key: max(value, found[key]) for key, value in worst.items()}
    return worst


def met(
    simulated: Simulated, emulated: Bench[Any], speed: float, look: Callable[[], None] = lambda: None
) -> tuple[float, float]:
    """Drive both into the wall ahead; return after how many seconds each has read that it touches it."""
    touched = [0.0, 0.0]
    for frame in range(round(DEPTH_MM / speed / FRAME_S)):
        drive_both(simulated, emulated, FRAME_S, (speed, 0.0))
        look()
        for i, base in enumerate((simulated.base, emulated.base)):
            if base.front_bumper and not touched[i]:
                touched[i] = (frame + 1) * FRAME_S
        if all(touched):
            break
    assert all(touched)
    drive_both(simulated, emulated, REST_S, (0.0, 0.0))
    return touched[0], touched[1]


def as_ranges(value: object) -> tuple[float, ...]:
    """Return a reading of ranges, where what is invalid is none."""
    assert isinstance(value, tuple)
    return tuple(math.inf if one is None else float(one) for one in value)


def test_a_pioneer_goes_where_its_emulator_goes_and_hears_what_it_hears() -> None:
    worst = toured(Simulated("pioneer"), emulated_pioneer(), ("Sonar", "range", "sonar"), 5000.0)
    bounds = {"mm": 5.0, "deg": 0.2, "mm/s": 2.0, "deg/s": 1.0, "range": 120.0}
    assert {name: value for name, value in worst.items() if value > bounds[name]} == {}


@pytest.mark.long
def test_a_create_goes_where_its_emulator_goes() -> None:
    """Its wheels turn at whole mm/s, and how fast it speeds up is nowhere written."""
    worst = toured(Simulated("create2"), emulated_create(), ("Light", "range", "range"), 300.0)
    bounds = {"mm": 100.0, "deg": 2.0, "mm/s": 5.0, "deg/s": 2.0, "range": 60.0}
    assert {name: value for name, value in worst.items() if value > bounds[name]} == {}


def test_a_pioneer_meets_a_wall_where_its_emulator_does() -> None:
    simulated, emulated = Simulated("pioneer"), emulated_pioneer()
    touched = met(simulated, emulated, 200.0)
    assert abs(touched[0] - touched[1]) <= 0.3
    assert abs(simulated.base.y - emulated.base.y) <= 10.0
    assert not simulated.base.rear_bumper
    assert not emulated.base.rear_bumper


@pytest.mark.long
def test_a_create_meets_a_wall_to_its_left_where_its_emulator_does() -> None:
    simulated, emulated = Simulated("create2", heading=-20.0), emulated_create(heading=-20.0)
    worst = 0.0

    def compare() -> None:
        nonlocal worst
        seen = emulated.measured.readings(emulated.now_ns)["range"].value
        for a, b in zip(simulated.read("Light", "range"), as_ranges(seen), strict=True):
            worst = max(worst, abs(min(a, 300.0) - min(b, 300.0)))

    touched = met(simulated, emulated, 100.0, compare)
    assert abs(touched[0] - touched[1]) <= 0.3
    assert simulated.read("Skirt", "bumper") == (True, False)
    assert emulated.measured.readings(emulated.now_ns)["bumper"].value == (True, False)
    assert (
        20.0 < worst <= 150.0
    )  # its noise alone is 40 mm at the end of its reach, and both curves are guessed


def test_a_create_sees_an_edge_where_its_emulator_falls_back_to_passive_mode() -> None:
    """It stops by itself, a fault to the driver of the base; that of `Floor` reads on."""
    edge = 600.0
    hole = np.array([(-2000.0, edge), (2000.0, edge), (2000.0, 2500.0), (-2000.0, 2500.0)])
    simulated = Simulated("create2", holes=[hole], heading=40.0)
    firmware = CreateFirmware(CreateWorld(range=ROOM, floor=lambda x, y: x < edge))
    firmware.pose = (0.0, 0.0, 40.0)
    emulated = Bench(Create2(), firmware)
    emulated.open(1.5)
    while not any(simulated.read("Floor", "cliff")):
        simulated.run(FRAME_S, (100.0, 0.0))
    with pytest.raises(OpeningError, match="a cliff"):
        emulated.run(20.0, (100.0, 0.0))
    assert emulated.last is not None
    seen = Create2().read(emulated.last, 0).fields["cliff"]
    assert tuple(map(bool, simulated.read("Floor", "cliff"))) == seen == (False, False, False, True)
    assert simulated.world.true_pose(0).y_mm == pytest.approx(firmware.pose[0], abs=10.0)
