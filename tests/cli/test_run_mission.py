"""`colony run --from ROOM --to ROOM`: scripts among the real servers in virtual time."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.conftest import Colony

ROOT = Path(__file__).parents[2]
NAVIGATOR = str(ROOT / "behaviors" / "navigator.colony")
MAP = str(ROOT / "maps" / "msu_engineering_3.stickrep")


def test_a_robot_is_sent_around_a_corner_and_arrives(colony: Colony, tmp_path: Path) -> None:
    way = ("--from", "A392L", "--to", "A340R", "--hazards", "3")
    result = colony("run", NAVIGATOR, "--map", MAP, *way, "--no-picture", "--format", "json")
    assert result.code == 0
    told = json.loads(result.out)
    assert told["arrival"]["arrived"] is True
    assert "from A392L to A340R (lcd): arrived after" in told["arrival"]["text"]


def test_who_does_not_arrive_is_told_where_it_is(colony: Colony) -> None:
    way = ("--from", "A392L", "--to", "A340R", "--duration", "10")
    result = colony("run", NAVIGATOR, "--map", MAP, *way, "--no-picture")
    assert result.code == 1
    assert "from A392L to A340R (lcd): not done after 10.0 s" in result.out


def test_rooms_that_are_not_there_and_half_a_way_are_refused(colony: Colony) -> None:
    unknown = colony("run", NAVIGATOR, "--map", MAP, "--from", "A392L", "--to", "A34OR", "--no-picture")
    assert unknown.code == 2
    assert "goal `A34OR`" in unknown.err
    assert "did you mean" in unknown.err
    half = colony("run", NAVIGATOR, "--map", MAP, "--from", "A392L")
    assert half.code == 2
    assert "found --from alone" in half.err
    alone = colony("run", NAVIGATOR, "--map", MAP, "--hazards", "1")
    assert alone.code == 2
    assert "--hazards goes with --from and --to" in alone.err


def test_processes_take_no_way(colony: Colony) -> None:
    result = colony("run", NAVIGATOR, "--map", MAP, "--processes", "--from", "A392L", "--to", "A340R")
    assert result.code == 2
    assert "--from and --to are for a run in one process" in result.err
