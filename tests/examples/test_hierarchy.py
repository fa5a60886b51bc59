"""examples/hierarchy: the three layers as processes, by the commands of the page; and one of them killed."""

from __future__ import annotations

import math
import re

import pytest

from colony.runtime.kit.connection import Session
from colony.runtime.library import data
from tests.cli.machine import contracts_held
from tests.examples.stage import ROOT, machine
from tests.waiting import until

HERE = ROOT / "examples" / "hierarchy"
README = (HERE / "README.md").read_text(encoding="utf-8")
[SHELL] = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
SERVE, CONTROL, TASK, MISSION = SHELL.splitlines()
PLACES = [tuple(map(float, place.split(","))) for place in re.findall(r"--place (\S+)", MISSION)]

ROBOT = "layered"
"""No description has its name, so it has no interface and no limits but those of the program."""

FASTEST_MM_S = 400.0
WITHIN_S = 0.3
BRAKING_MM = FASTEST_MM_S**2 / (2 * 800.0)


@pytest.mark.long
def test_the_mission_completes_and_a_dead_task_layer_is_a_robot_that_stands() -> None:
    with machine() as on:
        on.start(SERVE)
        on.there(ROBOT, "Clock", "RServer", "PServer", "DServer")
        control, task = on.start(CONTROL), on.start(TASK)
        mission = on.start(MISSION)
        mission.says("mission complete")
        assert mission.result() == 0
        with Session.open(ROBOT, environment=on.environment) as rome, on.plant(ROBOT) as plant:
            layers = rome.connect("DServer")
            assert layers.do(data.get("Mission", type=str)) == "complete"
            assert layers.do(data.get("TaskState", type=str)) == "arrived"
            here = plant.truth(ROBOT)
            assert math.dist((here.x, here.y), PLACES[-1]) < 400.0

            layers.do(data.set("Goal", {"number": 3, "x": here.x + 15_000.0, "y": 1500.0}))
            until(lambda: plant.truth(ROBOT).velocity > 0.9 * FASTEST_MM_S, "the robot drives")
            before = plant.truth(ROBOT)
            task.kill()
            until(lambda: plant.truth(ROBOT).velocity == 0.0, "the robot stands")
            after = plant.truth(ROBOT)
            late_s = 3 * 0.05  # what was said as it died, a frame for it, and one until it is commanded
            most = FASTEST_MM_S * (WITHIN_S + late_s) + BRAKING_MM
            assert math.dist((before.x, before.y), (after.x, after.y)) < most + 100.0
        control.finish()
        assert contracts_held(control.printed()), control.printed()


@pytest.mark.parametrize("name", re.findall(r"\]\(([^)#]+)\)", README))
def test_links_lead_somewhere(name: str) -> None:
    assert (HERE / name).exists()


def test_every_variable_of_the_page_is_one_of_the_layers() -> None:
    texts = "".join((HERE / name).read_text() for name in ("mission.py", "task.py", "control.colony"))
    for variable in ("Goal", "Mission", "Arrived", "TaskHeading", "TaskSpeed", "TaskState", "Pose"):
        assert variable in README
        assert f'"{variable}"' in texts or f"DServer.{variable}" in texts
