"""Lists of runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.nav.maps.building import Building, load_building
from colony.nav.plan.route import plan
from colony.nav.shared import GoalKind
from studies.lists import (
    PUBLISHED_MAP,
    RunListError,
    csv_list,
    floors_list,
    published_list,
    random_list,
    rooms_of,
    selected_runs,
)

BUILDING = load_building(PUBLISHED_MAP)
FLOOR = BUILDING.maps[0]


def test_the_forty_published_runs() -> None:
    runs = published_list()
    assert [run.number for run in runs] == list(range(1, 41))
    assert (runs[0].origin, runs[0].goal) == ("350R", "376L")
    assert (runs[39].origin, runs[39].goal) == ("A365L", "301R")
    assert all(run.published is not None for run in runs)


def test_ones_own_list(tmp_path: Path) -> None:
    path = tmp_path / "rounds.csv"
    path.write_text("From, To\n350R,376L\n\n 341L , 311R \n")
    runs = csv_list(path, BUILDING)
    assert [(run.number, run.origin, run.goal) for run in runs] == [(1, "350R", "376L"), (2, "341L", "311R")]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no runs; expected lines such as 350R,376L"),
        ("from,to\n", "no runs"),
        ("350R\n", r"rounds.csv:1: 1 fields; expected 2"),
        ("from,to\n350R,376L\n350R,376X\n", r"rounds.csv:3: .*goal `376X`"),
        ("350R,350R\n", r"rounds.csv:1: `350R` and `350R` are the same place"),
    ],
)
def test_bad_lists_are_told_with_their_line(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "rounds.csv"
    path.write_text(text)
    with pytest.raises(RunListError, match=told):
        csv_list(path, BUILDING)


def test_a_list_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(RunListError, match="cannot be read"):
        csv_list(tmp_path / "none.csv", BUILDING)


@pytest.mark.thorough
def test_random_pairs_are_the_same_for_a_seed_and_can_be_driven() -> None:
    runs = random_list(FLOOR, 30, 1)
    assert runs == random_list(FLOOR, 30, 1)
    assert runs != random_list(FLOOR, 30, 2)
    assert len({(run.origin, run.goal) for run in runs}) > 25
    assert set(rooms_of(FLOOR)) > {run.origin for run in runs}
    for run in runs[:5]:
        assert plan(FLOOR, run.origin, run.goal).segments


@pytest.mark.thorough
def test_random_pairs_of_rooms_on_different_floors() -> None:
    runs = floors_list(BUILDING, 40, 1)
    assert runs == floors_list(BUILDING, 40, 1)
    assert runs != floors_list(BUILDING, 40, 2)
    plans = [plan(BUILDING, run.origin, run.goal) for run in runs]
    assert {p.floors for p in plans} == {
        ("msu_engineering_3", "msu_engineering_2"),
        ("msu_engineering_2", "msu_engineering_3"),
    }
    assert all(run.has_ride for run in runs)
    has_ride = {segment.doors for p in plans for segment in p.segments if segment.kind is GoalKind.ELEVATOR}
    assert has_ride == {("acs.elev.L", "acs.elev.L"), ("old.elev.L", "old.elev.L")}


def test_a_list_of_ones_own_tells_which_runs_take_an_elevator(tmp_path: Path) -> None:
    path = tmp_path / "rounds.csv"
    path.write_text("350R,376L\n350R,2:250R\n2:250R,2:235L\n")
    runs = csv_list(path, BUILDING)
    assert [run.has_ride for run in runs] == [False, True, False]
    assert runs[2].floors == ("msu_engineering_2",)


def test_one_floor_has_no_pairs_on_different_floors() -> None:
    with pytest.raises(RunListError, match="lead to 1 floors with doors; expected at least 2"):
        floors_list(Building(maps=(FLOOR,)), 3, 1)


def test_rooms_are_named_once() -> None:
    rooms = rooms_of(FLOOR)
    assert "350L" in rooms
    assert "350R" not in rooms
    assert len(rooms) == len(set(rooms)) > 60


def test_runs_are_chosen_by_their_numbers() -> None:
    runs = published_list()
    assert [run.number for run in selected_runs(runs, "1-3, 22")] == [1, 2, 3, 22]
    for text, told in (
        ("", "not a range of runs"),
        ("x", "not a range of runs"),
        ("41", "no run 41"),
        ("3-1", "no run"),
    ):
        with pytest.raises(RunListError, match=told):
            selected_runs(runs, text)
