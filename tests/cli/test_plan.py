"""`colony plan`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.paths import MAPS

THIRD = MAPS / "msu_engineering_3.stickrep"


def test_a_plan_for_programs(colony: Colony) -> None:
    plan = json.loads(colony.output("plan", THIRD, "350R", "376L", "--format", "json"))
    assert (plan["origin"], plan["goal"], plan["modes"]) == ("350R", "376L", "ld")
    assert plan["distance_mm"] == pytest.approx(78_181.2, abs=1.0)
    assert plan["picture"] is None
    lights, last = plan["segments"]
    assert (lights["mode"], last["mode"]) == ("L", "D")
    assert lights["lights_mm"][-1] == pytest.approx(lights["length_mm"], abs=0.2)
    assert last["from"] == lights["to"]
    assert last["to"]["floor"] == "msu_engineering_3"


def test_a_plan_is_drawn(colony: Colony, tmp_path: Path) -> None:
    out = colony.output("plan", MAPS / "loop.stickrep", "201", "216", "-o", "p.svg")
    assert out.splitlines()[-1] == "drawn in p.svg"
    assert "<svg" in (tmp_path / "p.svg").read_text()
    err = colony.refusal("plan", MAPS / "loop.stickrep", "201", "216", "-o", "p.pdf")
    assert "expected a file ending in .png or .svg" in err


def test_a_plan_may_travel_the_other_way(colony: Colony) -> None:
    once_around = colony("plan", THIRD, "343R", "345R").out
    back = colony("plan", THIRD, "343R", "345R", "--travel", "either").out
    assert "modes: lclcl" in once_around
    assert "modes: d\n" in back


def test_a_plan_may_be_a_ride_alone(colony: Colony) -> None:
    out = colony.output("plan", THIRD, "acs.elev.L", "2:acs.elev.L")
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
    err = colony.one_line("plan", path, origin, goal, "-o", "p.png")
    assert err.startswith(f"{path}: error: {message}")
    assert not Path("p.png").exists()


def test_a_bad_map_gets_its_errors(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "bad.stickrep").write_text("stickrep 1\nmap m\nstart 0 0\n")
    assert "bad.stickrep:3:" in colony.refusal("plan", "bad.stickrep", "a", "b")
    assert colony("plan", "nowhere.stickrep", "a", "b").code == 2
