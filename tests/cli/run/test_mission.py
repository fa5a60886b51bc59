"""`colony run --from ROOM --to ROOM`: scripts among the real servers in virtual time, also between floors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Colony
from tests.cli.machine import Machine, Started
from tests.nav.floors import two_floors
from tests.paths import ROOT

NAVIGATOR = str(ROOT / "behaviors" / "navigator.colony")
MAP = str(ROOT / "maps" / "msu_engineering_3.stickrep")


@pytest.mark.long
def test_a_robot_is_sent_around_a_corner_and_arrives(colony: Colony, tmp_path: Path) -> None:
    way = ("--from", "A392L", "--to", "A340R", "--hazards", "3")
    told = json.loads(colony.output("run", NAVIGATOR, "--map", MAP, *way, "--no-picture", "--format", "json"))
    assert told["arrival"]["arrived"] is True
    assert told["arrival"]["pictures"] == []
    assert "from A392L to A340R (lcd): arrived after" in told["arrival"]["text"]
    assert told["arrival"]["text"].endswith("; the goal's plate was read")


def test_a_robot_is_sent_down_a_corridor_and_arrives(colony: Colony, tmp_path: Path) -> None:
    two_floors(tmp_path)
    way = ("--map", str(tmp_path / "ground.stickrep"), "--from", "liftL", "--to", "C")
    assert "from liftL to C (d): arrived after" in colony.output("run", NAVIGATOR, *way, "--no-picture")


def test_who_does_not_arrive_is_told_where_it_is_and_its_way_is_drawn_on_both_floors(
    colony: Colony, tmp_path: Path
) -> None:
    two_floors(tmp_path)
    way = ("--map", str(tmp_path / "ground.stickrep"), "--from", "A", "--to", "2:C", "--picture", "way.svg")
    result = colony("run", NAVIGATOR, *way, "--duration", "1")
    assert result.code == 1
    assert "from A to C of upper (dvd): not done after 1.0 s, on ground, not on upper" in result.out
    assert "<svg" in Path("way.svg").read_text()
    assert "<svg" in Path("way.upper.svg").read_text()
    wrote = [line.split("wrote ")[1] for line in result.out.splitlines() if "wrote " in line]
    assert wrote == ["way.svg", "way.upper.svg"]


@pytest.mark.parametrize(
    ("way", "said"),
    [
        (
            ("--from", "A", "--to", "liftX"),
            "there is no goal `liftX` in the map `ground` or `upper`; did you mean `lift`",
        ),
        (("--from", "A", "--to", "7:C"), "there is no goal `7:C` in the map `ground` or `upper`"),
        (("--from", "A"), "found --from alone"),
        (("--hazards", "1"), "--hazards requires --to"),
    ],
)
def test_rooms_that_are_not_there_and_half_a_way_are_refused(
    colony: Colony, tmp_path: Path, way: tuple[str, ...], said: str
) -> None:
    two_floors(tmp_path)
    err = colony.refusal("run", NAVIGATOR, "--map", str(tmp_path / "ground.stickrep"), *way, "--no-picture")
    assert said in err


@pytest.mark.parametrize("options", [(), ("--processes",)], ids=["in one process", "processes"])
def test_missions_are_for_the_body_of_rome(colony: Colony, options: tuple[str, ...]) -> None:
    way = ("--map", str(ROOT / "maps" / "loop.stickrep"), "--from", "201", "--to", "216")
    err = colony.refusal("run", "wander", "--robot", "amr", *way, *options, "--no-picture")
    assert "--from and --to: error: `amr` has another body" in err


def ridden(machine: Machine, ground: Path) -> tuple[Started, dict[str, Any]]:
    """A run to the other floor by processes, and its report.

    Where the machine is so busy that clients are lost, the program's memory begins again, also that of where
    the robot is on its ride: such a run says nothing, and there is another one.
    """
    way = ("--map", str(ground), "--from", "liftR", "--to", "upper:liftR", "--duration", "4min")
    options = ("--processes", "--record", "run.mcap", "--seed", "31", "--format", "json")
    for _ in range(3):
        run = machine.start("run", NAVIGATOR, *way, *options)
        code = run.wait(600.0)
        report = json.loads(run.out)
        if code == 0 or report["restarts"] == 0:
            break
    assert code == 0, run.out + run.err
    return run, report


@pytest.mark.thorough
def test_a_robot_of_processes_rides_to_another_floor_and_its_decisions_are_the_interpreter_s(
    machine: Machine, colony: Colony, tmp_path: Path
) -> None:
    two_floors(tmp_path)
    run, report = ridden(machine, tmp_path / "ground.stickrep")
    assert report["disagreements"] == []
    assert report["arrival"]["arrived"] is True
    assert "from liftR to liftR of upper (dvd): arrived after" in report["arrival"]["text"]
    assert (run.folder / "run.png").stat().st_size > 1000
    assert report["arrival"]["pictures"] == ["run.upper.png"]
    audited = colony("audit", run.folder / "run.mcap", "--format", "json")
    assert audited.code == 0, audited.out + audited.err
    assert json.loads(audited.out)["agrees"] is True


def test_drive_requires_map_and_goal_together(colony: Colony) -> None:
    way = ("--from", "350R", "--to", "352L")
    no_map = colony("drive", NAVIGATOR, *way)
    assert (no_map.code, "--to requires --map MAP, the building to drive through" in no_map.err) == (2, True)
    no_way = colony("drive", NAVIGATOR, "--map", MAP)
    assert (no_way.code, "--map is for --from and --to" in no_way.err) == (2, True)
