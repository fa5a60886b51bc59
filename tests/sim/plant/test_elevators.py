"""Elevators of a plant: doors and rides over its control channel, cameras, and an operator outside."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from colony.nav.maps.building import Building
from colony.nav.maps.world_map import world_of
from colony.nav.shared import ELEVATOR_CALL, FLOOR_REACHED
from colony.runtime.protocol.images import Image
from colony.sim.plant.assembly import PlantOptions, assembled_devices
from colony.sim.plant.control import PlantControl
from colony.sim.plant.elevators import RemoteElevators
from colony.sim.plant.protocol import Truth
from colony.sim.world.elevators import CABIN_DEPTH_MM, SLIDE_S, Cabin, cabin_of
from colony.sim.world.operator import DELAY_S, POLL_INTERVAL_S, RIDE_S, STANDSTILL_S, operator
from colony.sim.world_spec import WorldSpec
from tests.buildings import HALLWAY
from tests.kit.script_stage import RobotStage
from tests.nav.floors import two_floors
from tests.sim.plant.plants import START, controlled
from tests.sim.robots import FRONT_CAMERA, IDEAL, UP_CAMERA

STEP_NS = 50_000_000
DOORS = "liftL"
NOTICED_S = STANDSTILL_S + 3 * POLL_INTERVAL_S

Pose = tuple[float, float, float]


def before(cabin: Cabin) -> Pose:
    """Where a robot waits, and looks at the doors."""
    return (*cabin.point_at(0.0, -1000.0), cabin.heading_deg)


def inside(cabin: Cabin) -> Pose:
    """Where a robot stands to ride, and looks at the doors."""
    return (*cabin.point_at(0.0, CABIN_DEPTH_MM / 2), (cabin.heading_deg + 180.0) % 360.0)


def options(building: Building, path: Path, pose: Pose, *floors: str) -> PlantOptions:
    return PlantOptions(
        path=path / "plant",
        world=world_of(building.map_named(floors[0])),
        building=building,
        spec=WorldSpec(floors=floors),
        robots={"rome": pose},
        cameras={"ahead": FRONT_CAMERA, "up": UP_CAMERA},
        config=IDEAL,
        step_ns=STEP_NS,
    )


class Time:
    """The clock of a plant, which a test advances step by step. Mutable."""

    now_ns = 0

    def __call__(self) -> int:
        return self.now_ns

    def wait(self, control: PlantControl, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.now_ns += STEP_NS
            while control.truth("rome").t_ns < self.now_ns:
                pass


def test_doors_slide_and_a_ride_behind_shut_doors_takes_the_robot_to_the_other_floor(tmp_path: Path) -> None:
    building = two_floors(tmp_path)
    ground, upper = (cabin_of(floor, DOORS) for floor in building.maps)
    given, time = options(building, tmp_path, before(ground), "ground", "upper"), Time()
    with controlled(given, clock=time) as control:
        assert (control.truth("rome").floor, control.opening(DOORS)) == ("ground", 0.0)
        control.move_doors(DOORS, is_opening=True)
        time.wait(control, SLIDE_S / 2)
        assert control.opening(DOORS) == pytest.approx(0.5)
        time.wait(control, SLIDE_S / 2)
        assert control.opening(DOORS) == pytest.approx(1.0)
        control.place("rome", *inside(ground))
        with pytest.raises(ValueError, match=f"the doors at `{DOORS}` are open; close them"):
            control.ride(DOORS, "upper")
        control.move_doors(DOORS, is_opening=False)
        time.wait(control, SLIDE_S + STEP_NS / 1e9)
        with pytest.raises(ValueError, match="does not lead to `roof`"):
            control.ride(DOORS, "roof")
        assert control.ride(DOORS, "upper") == DOORS
        truth = control.truth("rome")
        assert (truth.floor, control.opening(DOORS)) == ("upper", 0.0)
        assert (truth.x, truth.y, truth.heading) == pytest.approx(inside(upper))
        with pytest.raises(ValueError, match="`upper` has no elevator at `C`; it has liftL"):
            control.move_doors("C", is_opening=True)


def test_a_plant_of_one_map_has_no_elevators(tmp_path: Path) -> None:
    alone = PlantOptions(
        path=tmp_path / "plant", world=world_of(HALLWAY), robots={"rome": START}, config=IDEAL
    )
    with controlled(alone) as control:
        assert control.truth("rome").floor == HALLWAY.name
        for ask in (lambda: control.opening(DOORS), lambda: control.ride(DOORS, "upper")):
            with pytest.raises(
                ValueError, match=f"no elevators: the simulator has one floor, `{HALLWAY.name}`"
            ):
                ask()


def test_cameras_see_the_floor_on_which_the_robot_is(tmp_path: Path) -> None:
    """Both floors have the same corridor to the east, and that of the upper one is longer by two meters."""
    building = two_floors(tmp_path)
    place = (8_000.0, 1_000.0, 270.0)

    def seen(*floors: str, ride: bool = False) -> Image:
        there = inside(cabin_of(building.map_named(floors[0]), DOORS))
        start = before(cabin_of(building.map_named(floors[0]), DOORS))
        devices = assembled_devices(options(building, tmp_path, start, *floors), lambda: 7)
        if ride:
            devices.elevators.open(DOORS)
            for _ in range(round(SLIDE_S * 1e9 / STEP_NS) + 1):
                devices.advance(devices.time_ns + STEP_NS)
            devices.place(0, *there)
            devices.elevators.close(DOORS)
            for _ in range(round(SLIDE_S * 1e9 / STEP_NS) + 1):
                devices.advance(devices.time_ns + STEP_NS)
            devices.elevators.ride(DOORS, floors[1])
        devices.place(0, *place)
        return devices.image(0, "ahead")

    ground, upper, ridden = seen("ground"), seen("upper"), seen("ground", "upper", ride=True)
    assert np.abs(pixels(ridden) - pixels(upper)).mean() < np.abs(pixels(ridden) - pixels(ground)).mean() / 2


def pixels(image: Image) -> np.ndarray:
    return np.frombuffer(image.pixels, dtype=np.uint8).astype(float)


class Outside:
    """An operator who reaches the elevators over the plant's socket. Mutable: all of it."""

    def __init__(self, control: PlantControl, building: Building, time: Time) -> None:
        self._control, self._time = control, time
        elevators = RemoteElevators(control, "rome", building, IDEAL.radius_mm)
        self.stage = RobotStage(operator=operator(elevators, seed=1))

    def until(self, condition: Callable[[Truth], bool], most_s: float) -> None:
        end_ns = self.stage.now_ns + round(most_s * 1e9)
        while not condition(self._control.truth("rome")):
            assert self.stage.now_ns < end_ns, f"in vain for {most_s} s"
            self.stage.run(0.05, lambda: self._time.wait(self._control, 0.05))


def test_an_operator_in_another_process_presses_the_buttons_and_says_when_the_robot_has_arrived(
    tmp_path: Path,
) -> None:
    building, time = two_floors(tmp_path), Time()
    ground, upper = (cabin_of(floor, DOORS) for floor in building.maps)
    with controlled(options(building, tmp_path, before(ground), "ground", "upper"), clock=time) as control:
        hall = Outside(control, building, time)
        hall.stage.tell(ELEVATOR_CALL, [DOORS, "ground", "upper"])
        hall.until(lambda _: control.opening(DOORS) == 1.0, DELAY_S[1] + NOTICED_S + SLIDE_S)
        control.place("rome", *inside(ground))
        hall.until(lambda truth: truth.floor == "upper", SLIDE_S + RIDE_S[1] + NOTICED_S)
        assert hall.stage.told(FLOOR_REACHED) == 0
        hall.until(lambda _: hall.stage.told(FLOOR_REACHED) == 1, SLIDE_S + NOTICED_S)
        assert control.opening(DOORS) == 1.0
        control.place("rome", *before(upper))
        hall.stage.tell(ELEVATOR_CALL, [])
        hall.until(lambda _: control.opening(DOORS) == 0.0, SLIDE_S + 1.0)
