"""examples/room_to_room.py: scripts over live connections lead a robot of real processes to a room."""

from __future__ import annotations

import math

import pytest

from colony.nav.maps.stickrep.reader import load_map
from colony.nav.plan.route import plan
from tests.examples.stage import ROOT, machine

MAP = "maps/msu_engineering_3.stickrep"


@pytest.mark.long
def test_a_robot_of_processes_is_led_to_the_next_room() -> None:
    with machine() as here:
        here.start(
            f"colony run behaviors/navigator.colony --map {MAP} --processes --camera CServerUp=up "
            "--duration 5min --no-picture"
        )
        here.there("rome", "DServer", "RServer", "PServer", "CServerUp", "Clock")
        leading = here.start(f"python examples/room_to_room.py rome {MAP} 350R 352L")
        leading.says("350R to 352L: ld, 5.0 m")
        leading.says("arrived")
        assert leading.result() == 0
        with here.plant("rome") as plant:
            truth = plant.truth("rome")
    goal = plan(load_map(ROOT / MAP), "350R", "352L").segments[-1].end
    assert math.hypot(truth.x - goal.x_mm, truth.y - goal.y_mm) < 300.0


def test_a_room_that_is_not_there() -> None:
    with machine() as here:
        leading = here.run(f"python examples/room_to_room.py rome {MAP} 350R 35Z")
        assert leading.ended == 2
        assert "35Z" in leading.printed()


def test_a_map_or_a_robot_that_is_not_there_is_told_in_a_line() -> None:
    with machine() as here:
        for map_path, ended, told in (
            ("maps/nowhere.stickrep", 2, "cannot read"),
            (MAP, 1, "no robot `rome`"),
        ):
            leading = here.run(f"python examples/room_to_room.py rome {map_path} 350R 352L")
            assert leading.ended == ended
            assert told in leading.printed()
            assert "Traceback" not in leading.printed()
