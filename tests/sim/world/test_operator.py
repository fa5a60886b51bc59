"""Who presses the buttons of elevators: when the doors open, when they shut, when the robot is told."""

from __future__ import annotations

import pytest

from colony.nav.missions.elevator_calls import decode_elevator_call
from colony.nav.shared import ELEVATOR_CALL, FLOOR_REACHED
from colony.sim.world.elevators import CABIN_DEPTH_MM, SLIDE_S, Elevators, cabin_of
from colony.sim.world.operator import DELAY_S, POLL_INTERVAL_S, RIDE_S, STANDSTILL_S, operator
from colony.sim.world.world import World
from tests.kit.script_stage import RobotStage
from tests.sim.robots import IDEAL
from tests.sim.world.test_elevators import BUILDING, CABIN, FLOORS, NODE, SECOND, THIRD

CALL = [NODE, THIRD, SECOND]
BEFORE = (*CABIN.point_at(0.0, -1200.0), CABIN.heading_deg)
INSIDE = (*CABIN.point_at(0.0, CABIN_DEPTH_MM / 2), CABIN.heading_deg + 180.0)
NOTICED_S = STANDSTILL_S + 3 * POLL_INTERVAL_S


class Hall:
    """A robot before an elevator, and the operator. Mutable: all of it."""

    def __init__(self, seed: int = 1, pose: tuple[float, float, float] = BEFORE) -> None:
        self.world = World(walls=FLOORS[THIRD], poses=[pose], config=IDEAL)
        self.elevators = Elevators(self.world, BUILDING, FLOORS, THIRD)
        self.stage = RobotStage(operator=operator(self.elevators, seed=seed))
        self.openings: list[float] = []

    def call(self, call: list[str]) -> None:
        self.stage.tell(ELEVATOR_CALL, call)

    def wait(self, seconds: float) -> None:
        self.stage.run(seconds, self._frame)

    def until_open(self, most_s: float = 60.0) -> float:
        """Wait until doors begin to open; after how many seconds they do."""
        before = self.stage.now_ns
        while self.opening == 0.0:
            self.wait(0.05)
            assert self.stage.now_ns - before < most_s * 1e9, f"shut after {most_s} s"
        return (self.stage.now_ns - before) / 1e9

    @property
    def opening(self) -> float:
        return self.elevators.opening(NODE)

    @property
    def reached(self) -> object:
        return self.stage.told(FLOOR_REACHED)

    def _frame(self) -> None:
        self.world.advance(0.05)
        self.elevators.advance(0.05)
        self.openings.append(self.opening)


def opened(seed: int = 1) -> Hall:
    """Called, waited, and the doors are open."""
    hall = Hall(seed)
    hall.call(CALL)
    hall.until_open()
    hall.wait(SLIDE_S)
    assert hall.opening == 1.0
    return hall


def test_nobody_presses_a_button_for_a_robot_that_does_not_call() -> None:
    hall = Hall()
    hall.wait(60.0)
    assert max(hall.openings) == 0.0
    assert hall.reached == 0


def test_doors_open_some_time_after_the_robot_has_come_to_wait() -> None:
    waited = []
    for seed in range(1, 13):
        hall = Hall(seed)
        hall.call(CALL)
        waited.append(hall.until_open())
    assert all(DELAY_S[0] <= seconds <= DELAY_S[1] + NOTICED_S for seconds in waited)
    assert max(waited) - min(waited) > 5.0
    again = Hall(12)
    again.call(CALL)
    assert again.until_open() == waited[-1]


@pytest.mark.parametrize(
    "pose",
    [
        (*CABIN.point_at(0.0, -1200.0), CABIN.heading_deg + 40.0),
        (*CABIN.point_at(3000.0, -1200.0), CABIN.heading_deg),
    ],
    ids=["looks aside", "stands aside"],
)
def test_a_robot_that_does_not_stand_before_the_doors_waits_in_vain(
    pose: tuple[float, float, float],
) -> None:
    hall = Hall(pose=pose)
    hall.call(CALL)
    hall.wait(60.0)
    assert max(hall.openings) == 0.0


def test_a_robot_that_turns_about_does_not_wait_yet() -> None:
    hall = Hall()
    hall.call(CALL)
    for _ in range(30):
        hall.world.command(0, 0.0, 15.0)
        hall.wait(1.0)
        hall.world.command(0, 0.0, -15.0)
        hall.wait(1.0)
    assert max(hall.openings) == 0.0


def test_an_elevator_of_another_floor_does_not_come() -> None:
    hall = Hall()
    hall.call([NODE, SECOND, THIRD])
    hall.wait(60.0)
    assert max(hall.openings) == 0.0
    hall.call([])
    hall.wait(1.0)
    hall.call(CALL)
    hall.until_open()


def test_the_doors_stay_open_until_the_robot_has_turned_inside() -> None:
    hall = opened()
    hall.wait(30.0)
    assert hall.opening == 1.0
    hall.world.place(0, (*CABIN.point_at(0.0, CABIN_DEPTH_MM / 2), CABIN.heading_deg))
    hall.wait(30.0)
    assert hall.opening == 1.0
    assert hall.elevators.floor == THIRD


def test_it_rides_behind_shut_doors_and_is_told_when_they_are_open_again() -> None:
    hall = opened()
    hall.world.place(0, INSIDE)
    seen: list[tuple[str, float, object]] = []
    for _ in range(round((2 * SLIDE_S + RIDE_S[1] + NOTICED_S + 2.0) / 0.05)):
        hall.wait(0.05)
        seen.append((hall.elevators.floor, hall.opening, hall.reached))
    floors = [floor for floor, _, _ in seen]
    change = floors.index(SECOND)
    assert floors == [THIRD] * change + [SECOND] * (len(floors) - change)
    assert seen[change - 1][1] == 0.0
    assert {reached for _, _, reached in seen[:change]} == {0}
    told = next(number for number, (_, _, reached) in enumerate(seen) if reached == 1)
    assert all(opening == 1.0 for _, opening, _ in seen[told:])
    x, y, _ = hall.world.true_pose(0)
    there = cabin_of(BUILDING.map_named(SECOND), NODE)
    assert there.coordinates(x, y) == pytest.approx((0.0, CABIN_DEPTH_MM / 2), abs=1.0)


def test_afterwards_the_doors_shut_and_nobody_is_told_any_more() -> None:
    hall = opened()
    hall.world.place(0, INSIDE)
    hall.wait(2 * SLIDE_S + RIDE_S[1] + NOTICED_S + 2.0)
    assert hall.reached == 1
    there = cabin_of(BUILDING.map_named(SECOND), NODE)
    hall.world.place(0, (*there.point_at(0.0, -1200.0), there.heading_deg + 180.0))
    hall.call([])
    hall.wait(SLIDE_S + 1.0)
    assert (hall.opening, hall.reached) == (0.0, 0)


def shutting(hall: Hall) -> None:
    """Until the doors have begun to shut on a robot inside."""
    hall.world.place(0, INSIDE)
    while hall.opening == 1.0:
        hall.wait(0.05)


def test_doors_that_meet_the_robot_open_and_are_shut_again() -> None:
    hall = opened()
    shutting(hall)
    hall.world.place(0, (*CABIN.point_at(0.0, 200.0), CABIN.heading_deg + 180.0))
    hall.wait(30.0)
    assert hall.elevators.floor == THIRD
    assert hall.opening > 0.8
    hall.world.place(0, INSIDE)
    hall.wait(2 * SLIDE_S + RIDE_S[1] + 2.0)
    assert hall.elevators.floor == SECOND


def test_a_robot_that_is_turned_away_when_it_is_to_go_is_let_out() -> None:
    hall = opened()
    shutting(hall)
    hall.world.place(0, (INSIDE[0], INSIDE[1], INSIDE[2] + 90.0))
    hall.wait(SLIDE_S + RIDE_S[1] + SLIDE_S + 1.0)
    assert min(hall.openings[-round(RIDE_S[1] / 0.05) :]) == 0.0
    assert (hall.elevators.floor, hall.opening) == (THIRD, 1.0)
    hall.world.place(0, INSIDE)
    hall.wait(2 * SLIDE_S + RIDE_S[1] + NOTICED_S + 2.0)
    assert hall.elevators.floor == SECOND


def test_a_call_that_is_taken_back_is_given_up() -> None:
    hall = opened()
    hall.call([])
    hall.wait(SLIDE_S + 1.0)
    assert hall.opening == 0.0
    hall.world.place(0, BEFORE)
    hall.call(CALL)
    assert hall.until_open() > DELAY_S[0]


@pytest.mark.parametrize("told", [None, 7, [], ["a", "b"], ["a", "b", 3], "abc", {"a": 1}])
def test_what_is_no_call_is_none(told: object) -> None:
    assert decode_elevator_call(told) is None
