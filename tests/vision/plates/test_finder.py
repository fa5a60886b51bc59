from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from colony.nav.pose.pose import fix_of
from colony.nav.shared import FLOOR, GOAL_DIRECTION, PLATE_FIX, PLATE_SEEN
from colony.runtime.kit.script import ScriptError
from colony.runtime.library import camera as cameras
from colony.runtime.protocol.calls import CallId, NoArguments, RefusedError
from colony.runtime.protocol.connections import Caller
from colony.runtime.servers.cserver import PERIOD_NS
from colony.vision.level_camera import AHEAD
from colony.vision.plates.finder import plate_finder
from colony.vision.plates.observations import FoundPlate
from tests.vision.plates.hall import Hall, Stage, known
from tests.vision.plates.walls import plate

HALL = Hall(boards=(plate("352", -600.0), plate("354", 700.0)))
SECONDS = 7.0
ASKED = CallId(Caller("test", "test", 0, "local"), 1)


def run(hall: Hall, *, direction: float | None = 0.0, seconds: float = SECONDS, **options: Any) -> tuple[
    Stage, list[FoundPlate]
]:  # fmt: skip
    """What is reported of the plates of a hall."""
    reported: list[FoundPlate] = []
    stage = Stage(hall, plates=plate_finder(on_plate=reported.append, reader=None, **options))
    if direction is not None:
        stage.tell(GOAL_DIRECTION, direction)
    stage.run(seconds)
    return stage, reported


def test_plates_are_told_to_who_listens_and_at_dserver() -> None:
    stage, reported = run(HALL)
    assert [found_plate.place for found_plate in reported] == [
        pytest.approx((-HALL.wall_mm, place), abs=40.0) for place in (-600.0, 700.0)
    ]
    t_ns, number, text, x, y = stage.told(PLATE_SEEN)
    assert (t_ns, number, text, (x, y)) == (reported[1].t_ns, 2, "", reported[1].place)
    assert stage.told(PLATE_FIX) is None
    assert set(stage.asked) == {"period", "set_period", "size", "grab_rows"}


def test_an_image_belongs_to_where_it_was_taken() -> None:
    stage, (found_plate, _) = run(HALL)
    assert found_plate.robot.y_mm == pytest.approx(stage.place(found_plate.t_ns), abs=1.0)


def test_without_a_direction_plates_are_found_all_the_same() -> None:
    assert len(run(HALL, direction=None)[1]) == 2


def test_nothing_is_found_while_the_robot_turns() -> None:
    stage, reported = run(HALL, direction=90.0)
    assert reported == []
    assert stage.asked.count("grab_rows") == 0


def test_with_the_map_plates_are_known_and_tell_where_the_robot_is() -> None:
    hall = replace(HALL, off_mm=(40.0, -60.0))
    stage, reported = run(hall, floors={"hall": known(hall)})
    assert [found_plate.door for found_plate in reported] == ["352", "354"]
    fix = fix_of(stage.told(PLATE_FIX))
    bearing = fix.rows[0]
    believed = bearing.cx * 40.0 + bearing.cy * (stage.place(fix.t_ns) - 60.0) - bearing.value
    true = bearing.cy * stage.place(fix.t_ns) - bearing.value
    assert abs(true) < 25.0 < abs(believed)


@pytest.mark.parametrize(
    ("floor", "doors"),
    [(None, ["352", "354"]), ("first", ["352", "354"]), ("second", []), ("cellar", []), (7, ["352", "354"])],
)
def test_the_map_is_that_of_the_floor(floor: object, doors: list[str]) -> None:
    reported: list[FoundPlate] = []
    floors = {"first": known(HALL), "second": ()}
    stage = Stage(HALL, plates=plate_finder(floors, on_plate=reported.append, reader=None))
    stage.tell(GOAL_DIRECTION, 0.0)
    if floor is not None:
        stage.tell(FLOOR, floor)
    stage.run(SECONDS)
    assert [found_plate.door for found_plate in reported] == doors


def test_servers_may_be_away_for_a_while() -> None:
    hall = replace(HALL, silent_s=(0.0, 4.4))
    _, reported = run(hall)
    assert [round(found_plate.place[1], -2) for found_plate in reported] == [700.0]


@pytest.mark.parametrize("away_s", [0.0, 1.0])
def test_a_camera_that_was_started_anew_is_told_its_period_again(away_s: float) -> None:
    stage, _ = run(HALL, seconds=1.0)
    present = stage.camera.handlers
    if away_s:
        stage.camera.handlers = dict.fromkeys(present, _away)
    stage.run(away_s)
    present["set_period"](ASKED, cameras.SetPeriod(period_ns=PERIOD_NS), stage.now_ns)
    stage.camera.handlers = present
    stage.run(1.0)
    assert stage.camera.handlers["period"](ASKED, NoArguments(), 0) == 250_000_000


def test_a_plate_that_is_found_while_dserver_is_away_is_told_later() -> None:
    reported: list[FoundPlate] = []
    stage = Stage(HALL, plates=plate_finder(on_plate=reported.append, reader=None))
    present = stage.data.handlers
    stage.data.handlers = dict.fromkeys(present, _away)
    stage.run(SECONDS)
    assert len(reported) == 2
    assert stage.told(PLATE_SEEN) is None
    stage.data.handlers = present
    stage.run(0.5)
    assert stage.told(PLATE_SEEN)[1] == 2


def test_while_dserver_is_away_the_floor_is_the_last_one_it_told() -> None:
    reported: list[FoundPlate] = []
    floors = {"first": (), "second": known(HALL)}
    stage = Stage(HALL, plates=plate_finder(floors, on_plate=reported.append, reader=None))
    stage.tell(FLOOR, "second")
    stage.run(0.5)
    stage.data.handlers = {**stage.data.handlers, "get": _away}
    stage.run(SECONDS)
    assert [found_plate.door for found_plate in reported] == ["352", "354"]


def _away(*_: object) -> object:
    raise RefusedError("unset", "it was restarted")


def test_a_camera_of_another_size_is_told() -> None:
    with pytest.raises(ScriptError, match="CServerSide gives images of 240 x 120 pixels; expected 640"):
        run(HALL, geometry=replace(AHEAD, columns=640, rows=480, yaw_deg=90.0))


def test_what_is_told_can_be_odd() -> None:
    stage, reported = run(HALL, direction=None, floors={"hall": known(HALL)}, seconds=0.5)
    for name, value in ((GOAL_DIRECTION, "north"), (FLOOR, ["hall"]), ("Pose", [1, 2])):
        stage.tell(name, value)
    stage.run(SECONDS)
    assert [found_plate.door for found_plate in reported] == ["352", "354"]


def test_plates_are_read_unless_told_otherwise() -> None:
    reported: list[FoundPlate] = []
    stage = Stage(Hall(boards=(plate("352", 0.0),)), plates=plate_finder(on_plate=reported.append))
    stage.tell(GOAL_DIRECTION, 0.0)
    stage.run(SECONDS)
    assert [(found_plate.text, found_plate.confidence > 0.9) for found_plate in reported] == [("352", True)]
