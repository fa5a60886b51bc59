"""`colony plan`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.paths import MAPS

THIRD = MAPS / "msu_engineering_3.stickrep"


def test_a_plan_is_a_table_of_segments(colony: Colony) -> None:
    code, out, err = colony("plan", THIRD, "341R", "381R")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].startswith("341R to 381R: 260.807 m, ")
    assert lines[1] == "modes: lclclcclcclclclclcd"
    assert [line[0] for line in lines[4:]] == list("LECLECLECECLECECLECLECLECLECD")
    assert "90°" in lines[6]


def test_a_plan_for_programs(colony: Colony) -> None:
    code, out, _ = colony("plan", THIRD, "350R", "376L", "--format", "json")
    plan = json.loads(out)
    assert code == 0
    assert (plan["origin"], plan["goal"], plan["modes"]) == ("350R", "376L", "ld")
    assert plan["distance_mm"] == pytest.approx(78_181.2, abs=1.0)
    assert plan["picture"] is None
    lights, last = plan["segments"]
    assert (lights["mode"], last["mode"]) == ("L", "D")
    assert lights["lights_mm"][-1] == pytest.approx(lights["length_mm"], abs=0.2)
    assert last["from"] == lights["to"]
    assert last["to"]["floor"] == "msu_engineering_3"


def test_a_plan_is_drawn(colony: Colony, tmp_path: Path) -> None:
    code, out, _ = colony("plan", MAPS / "loop.stickrep", "201", "216", "-o", "p.svg")
    assert code == 0
    assert out.splitlines()[-1] == "drawn in p.svg"
    assert "<svg" in (tmp_path / "p.svg").read_text()
    code, out, err = colony("plan", MAPS / "loop.stickrep", "201", "216", "-o", "p.pdf")
    assert (code, out) == (2, "")
    assert "expected a file ending in .png or .svg" in err


def test_a_plan_may_travel_the_other_way(colony: Colony) -> None:
    once_around = colony("plan", THIRD, "343R", "345R").out
    back = colony("plan", THIRD, "343R", "345R", "--travel", "either").out
    assert "modes: lclcl" in once_around
    assert "modes: d\n" in back


def test_a_plan_over_two_floors_names_them(colony: Colony) -> None:
    code, out, _ = colony("plan", THIRD, "372R", "2:264L")
    assert code == 0
    rows = out.splitlines()[4:]
    ride = next(i for i, row in enumerate(rows) if row.startswith("V"))
    assert all(row.endswith("msu_engineering_3") for row in rows[:ride])
    assert all(row.endswith("msu_engineering_2") for row in rows[ride:])


def test_a_plan_may_be_a_ride_alone(colony: Colony) -> None:
    code, out, _ = colony("plan", THIRD, "acs.elev.L", "2:acs.elev.L")
    assert code == 0
    assert "modes: v\n" in out
    assert out.endswith("msu_engineering_2\n")


@pytest.mark.parametrize(
    ("origin", "goal", "message"),
    [
        ("201", "2055", "there is no goal `2055` in the map `loop`; did you mean `205`"),
        ("201", "201", "`201` and `201` are the same place; name a start and a goal that differ"),
    ],
)
def test_no_plan_is_one_line_that_says_why(colony: Colony, origin: str, goal: str, message: str) -> None:
    path = MAPS / "loop.stickrep"
    code, out, err = colony("plan", path, origin, goal, "-o", "p.png")
    assert (code, out) == (2, "")
    assert err.startswith(f"{path}: error: {message}")
    assert len(err.splitlines()) == 1
    assert not Path("p.png").exists()


def test_a_bad_map_gets_its_errors(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "bad.stickrep").write_text("stickrep 1\nmap m\nstart 0 0\n")
    code, out, err = colony("plan", "bad.stickrep", "a", "b")
    assert (code, out) == (2, "")
    assert "bad.stickrep:3:" in err
    assert colony("plan", "nowhere.stickrep", "a", "b").code == 2
