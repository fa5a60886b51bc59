from __future__ import annotations

from pathlib import Path

import pytest

from colony.nav.maps.building import MAX_MAPS, Landing, LandingRide, load_building
from colony.text.diagnostics import headline
from tests.diagnostics import problems_of
from tests.paths import MAPS


def floor(name: str, *lines: str, level: str | None = None) -> str:
    """A room with two elevators."""
    joints = "\n".join(lines)
    return f"""stickrep 1
map {name}
floor {level or name}
unit m
start 1 1 0
ring outline 0 0 0
-270 A W 0 5
-270 B W 0 3
 180 a.L E 0 1
 180 a.R W 0 1
-270 C W 0 3
 180 b.L E 0 1
 180 b.R W 0 1
-270 D W 0 5
{joints}
"""


@pytest.fixture
def tower(tmp_path: Path) -> Path:
    """Three floors: `a` goes between 1 and 2, `b` between 2 and 3, which is in another folder."""
    (tmp_path / "up").mkdir()
    (tmp_path / "1.stickrep").write_text(floor("one", "elevator a.L 2.stickrep a.L", level="1"))
    two = floor("two", "elevator a.L 1.stickrep a.L", "elevator b.L up/3.stickrep a.L", level="2")
    (tmp_path / "2.stickrep").write_text(two)
    (tmp_path / "up/3.stickrep").write_text(floor("three", "elevator a.L ../2.stickrep b.L", level="3"))
    return tmp_path


def errors_of(path: Path) -> list[str]:
    return [headline(d).removeprefix(f"{path.parent}/") for d in problems_of(load_building, path)]


def test_floors_are_loaded_once_and_near_ones_first(tower: Path) -> None:
    building = load_building(tower / "1.stickrep")
    assert [m.name for m in building.maps] == ["one", "two", "three"]
    assert building.rides == (
        LandingRide(Landing("one", "a.L"), Landing("two", "a.L")),
        LandingRide(Landing("two", "b.L"), Landing("three", "a.L")),
    )
    top = load_building(tower / "up" / "3.stickrep")
    assert [m.name for m in top.maps] == ["three", "two", "one"]
    assert len(top.rides) == 2


def test_a_folder_may_be_named_in_several_ways(tower: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tower)
    for path in ("2.stickrep", "./up/../2.stickrep", tower / "2.stickrep"):
        assert [m.name for m in load_building(path).maps] == ["two", "one", "three"]


def test_an_elevator_to_three_floors(tmp_path: Path) -> None:
    for here in "123":
        lines = [f"elevator a.L {there}.stickrep a.L" for there in "123" if there != here]
        (tmp_path / f"{here}.stickrep").write_text(floor(f"m{here}", *lines, level=here))
    building = load_building(tmp_path / "2.stickrep")
    assert [m.floor for m in building.maps] == ["2", "1", "3"]
    assert len(building.rides) == 3


def test_a_map_without_elevators_is_a_building() -> None:
    building = load_building(MAPS / "loop.stickrep")
    assert [m.name for m in building.maps] == ["loop"]
    assert building.rides == ()


def test_looking_up(tower: Path) -> None:
    building = load_building(tower / "1.stickrep")
    assert building.map_named("two").floor == "2"
    with pytest.raises(KeyError, match="no map `four`; it has one, two, three"):
        building.map_named("four")


def test_a_map_that_is_not_there(tower: Path) -> None:
    (tower / "up/3.stickrep").unlink()
    (line,) = errors_of(tower / "1.stickrep")
    assert line.startswith(
        "2.stickrep:16:14: error[M029]: the elevator `b.L` leads to a map that cannot be loaded"
    )


def test_an_unsound_map_on_the_way_is_told_with_its_own_place(tower: Path) -> None:
    text = (tower / "2.stickrep").read_text()
    (tower / "2.stickrep").write_text(text.replace("-270 D W 0 5", "-270 D W 0 6"))
    (line,) = errors_of(tower / "1.stickrep")
    assert line.startswith("2.stickrep:6:1: error[M018]")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "elevator a.L 2.stickrep c.L",
            "error[M029]: expected an elevator at `c.L` of `two`; it has no such node",
        ),
        (
            "elevator a.L 2.stickrep A",
            "error[M029]: expected an elevator at `A` of `two`; it has a wall after it",
        ),
        ("elevator a.L 1.stickrep b.L", "error[M029]: the elevator `a.L` leads to its own map"),
        ("elevator b.L 2.stickrep a.L", "error[M030]: the elevator `a.L` of `two` does not lead back here"),
        ("elevator a.L 2.stickrep b.L", "error[M030]: the elevator `b.L` of `two` does not lead back here"),
    ],
)
def test_elevators_that_do_not_fit(tower: Path, line: str, expected: str) -> None:
    (tower / "1.stickrep").write_text(floor("one", line, level="1"))
    first = errors_of(tower / "1.stickrep")[0]
    assert first.startswith("1.stickrep:15:")
    assert expected in first


def test_the_missing_line_is_told(tower: Path) -> None:
    (tower / "up/3.stickrep").write_text(floor("three", level="3"))
    (problem,) = problems_of(load_building, tower / "2.stickrep")
    assert problem.hint == f"add `elevator a.L ../2.stickrep b.L` to {tower}/up/3.stickrep"


def test_floors_and_maps_have_names_of_their_own(tower: Path) -> None:
    text = (tower / "2.stickrep").read_text()
    (tower / "2.stickrep").write_text(text.replace("floor 2", "floor  1 # sic").replace("map two", "map one"))
    assert [line.split(": ")[:2] for line in errors_of(tower / "1.stickrep")] == [
        ["2.stickrep:2:5", "error[M031]"],
        ["2.stickrep:3:8", "error[M031]"],
    ]


def test_a_building_has_an_end(tmp_path: Path) -> None:
    for i in range(MAX_MAPS + 2):
        lines = [f"elevator a.L {i - 1}.stickrep b.L"] * (i > 0) + [f"elevator b.L {i + 1}.stickrep a.L"]
        (tmp_path / f"{i}.stickrep").write_text(floor(f"m{i}", *lines))
    (line,) = errors_of(tmp_path / "0.stickrep")
    assert f"{MAX_MAPS - 1}.stickrep:16:14: error[M023]" in line
