"""The prompts for an operator at a terminal."""

from __future__ import annotations

from pathlib import Path

from colony.nav.maps.building import Building, load_building
from colony.nav.missions.elevator_calls import ElevatorCall, PollResult, elevator_prompt, instructions
from colony.nav.shared import ELEVATOR_CALL, FLOOR_REACHED
from tests.kit.script_stage import RobotStage
from tests.nav.floors import two_floors

CALL = ["liftL", "ground", "upper"]
BACK = ["liftL", "upper", "ground"]


class FakeLineInput:
    """An input with the given `lines`. Mutable."""

    def __init__(self) -> None:
        self.lines: list[PollResult] = []
        self.forgot = 0

    def discard(self) -> None:
        self.forgot += 1

    def poll(self) -> PollResult:
        return self.lines.pop(0) if self.lines else "nothing"


class Desk:
    """The script, what it said, and DServer. Mutable: all of it."""

    def __init__(self, building: Building) -> None:
        self.line_input, self.said = FakeLineInput(), list[str]()
        self.stage = RobotStage(prompt=elevator_prompt(building, self.line_input, say=self.said.append))

    def run(self, call: list[str]) -> object:
        """What FloorReached is, a second after ElevatorCall has become this."""
        self.stage.tell(ELEVATOR_CALL, call)
        self.stage.run(1.0)
        return self.stage.variable(FLOOR_REACHED)


def test_enter_tells_that_the_floor_is_reached(tmp_path: Path) -> None:
    desk = Desk(two_floors(tmp_path))
    assert desk.run([]) == 0
    assert desk.said == []
    assert desk.run(CALL) == 0
    assert desk.said == [
        "Press the button of the elevator lift on floor 1, up. "
        "When the robot has turned around inside, press the one for floor 2.",
        "Press Enter here when its doors are open on floor 2.",
    ]
    desk.line_input.lines.append("line")
    assert desk.run(CALL) == 1
    assert desk.run(CALL) == 1
    assert desk.run([]) == 0


def test_each_ride_is_asked_for_and_answered_by_itself(tmp_path: Path) -> None:
    desk = Desk(two_floors(tmp_path))
    desk.line_input.lines += ["line"]
    assert desk.run(CALL) == 1
    assert desk.run([]) == 0
    assert desk.run(BACK) == 0
    assert "on floor 2, down" in desk.said[2]
    desk.line_input.lines += ["line"]
    assert desk.run(BACK) == 1
    assert desk.line_input.forgot == 2


def test_a_line_too_many_is_kept_for_the_next_question(tmp_path: Path) -> None:
    """A pipe says all at once what a person says in time."""
    desk = Desk(two_floors(tmp_path))
    desk.line_input.lines += ["line", "line"]
    assert desk.run(CALL) == 1
    assert desk.line_input.lines == ["line"]


def test_where_nobody_can_answer_the_robot_goes_by_what_it_sees(tmp_path: Path) -> None:
    desk = Desk(two_floors(tmp_path))
    assert desk.run([]) == 0
    desk.line_input.lines.append("end")
    assert desk.run(CALL) == 1
    assert desk.said[-1] == "No answers can be read here: the robot leaves when it detects the open doors."
    assert desk.run([]) == 1
    assert desk.run(BACK) == 1
    assert len(desk.said) == 4
    assert desk.said[-1].startswith("Press the button of the elevator lift on floor 2")


def test_floors_that_are_not_counted_are_neither_up_nor_down(tmp_path: Path) -> None:
    two_floors(tmp_path)
    path = tmp_path / "ground.stickrep"
    path.write_text(path.read_text().replace("floor  1", "floor  lobby"))
    building = load_building(path)
    assert instructions(building, ElevatorCall("liftL", "ground", "upper")) == (
        "Press the button of the elevator lift on floor lobby. "
        "When the robot has turned around inside, press the one for floor 2."
    )
