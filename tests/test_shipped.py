"""Behaviors and maps that come with colony are found by their names, after files of one's own."""

from __future__ import annotations

from pathlib import Path

import pytest

import colony as library
from colony.shipped import Shipped
from colony.text.diagnostics import DiagnosticError
from tests.cli.conftest import Colony
from tests.cli.conftest import colony as colony
from tests.paths import BEHAVIORS, MAPS, ROBOTS, ROOT

OWN = "param slow = 100 mm/s\n"
"""A file of one's own, with the name of one that comes with colony."""

USER = """
import "rome"
import "teleop.colony" as far
import "wander" as own
module mine { when min(sonar) < 600 mm do drive(velocity = own.slow, turn = 0) }
network { drive = mine }
"""


def test_all_that_is_shipped_has_a_name() -> None:
    assert Shipped.BEHAVIOR.names() + Shipped.ROBOT.names() == [
        path.stem for path in [*(b for b in BEHAVIORS if b not in ROBOTS), *ROBOTS]
    ]
    assert Shipped.BEHAVIOR.find("rome") == str(ROOT / "robots" / "rome" / "rome.colony")
    maps = [path for path in MAPS.iterdir() if path.suffix in (".stickrep", ".yaml")]
    assert Shipped.MAP.names() == sorted(path.stem for path in maps)
    assert Shipped.MAP.names(".yaml") == ["office"]
    assert Shipped.MAP.path("loop") == MAPS / "loop.stickrep"
    assert Shipped.MAP.path("office") == MAPS / "office.yaml"
    assert Shipped.MAP.find("office") == Shipped.MAP.find("office.yaml") == str(MAPS / "office.yaml")
    assert Shipped.MAP.find("office.stickrep") == "office.stickrep"


def test_a_file_comes_before_a_name_and_a_folder_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shipped = str(ROOT / "behaviors" / "wander.colony")
    assert Shipped.BEHAVIOR.find("wander") == shipped
    assert Shipped.BEHAVIOR.find("wander.colony") == shipped
    assert Shipped.BEHAVIOR.find("./wander") == "./wander"
    assert Shipped.BEHAVIOR.find("loop") == "loop"
    Path("wander").mkdir()
    assert Shipped.BEHAVIOR.find("wander") == shipped
    Path("wander.colony").write_text("")
    assert Shipped.BEHAVIOR.find("wander.colony") == "wander.colony"
    assert Shipped.BEHAVIOR.find("wander") == "wander.colony"


@pytest.mark.parametrize("name", ["", ".", "..", "a\0b", "x" * 5000, "../maps/loop"])
def test_what_is_no_name_is_left_to_whoever_reads_it(name: str) -> None:
    assert Shipped.MAP.find(name) == name


def test_commands_take_names_and_say_what_may_be_meant(colony: Colony) -> None:
    assert colony("check", "wander").code == 0
    assert colony.refusal("check", "wandr").endswith("(did you mean `wander`?)\n")
    Path("forage.colony").write_text(OWN)
    for name in ("forag", "forag.colony"):
        assert colony("check", name).err.endswith("(did you mean `forage.colony`?)\n")
    assert colony("map", "loop", "--no-picture").code == 0
    assert "did you mean `loop`?" in colony.refusal("map", "lop")


def test_the_front_door_takes_names_and_says_what_may_be_meant() -> None:
    with pytest.raises(DiagnosticError) as failed:
        library.load("wandr")
    assert str(failed.value).endswith("No such file or directory (did you mean `wander`?)")
    assert library.load("figure_4_14").files[-1][0] == "figure_4_14.colony"


def test_an_import_takes_the_file_beside_it_with_or_without_its_suffix(tmp_path: Path) -> None:
    (tmp_path / "wander.colony").write_text(OWN)
    for name in ("wander", "wander.colony", "./wander"):
        (tmp_path / "user.colony").write_text(f'import "rome"\nimport "{name}" as own\nlet fast = own.slow\n')
        places = dict(library.load(tmp_path / "user.colony").files)
        assert places["wander.colony"].text == OWN


def test_a_file_may_extend_the_one_of_its_own_name(tmp_path: Path) -> None:
    (tmp_path / "rome.colony").write_text('import "rome"\nlet own = 500 mm\n')
    places = [place for place, _ in library.load(tmp_path / "rome.colony").files]
    shipped = ["colony.shipped/functions.colony", "colony.shipped/rome.colony"]
    assert places == [*shipped, "rome.colony"]


@pytest.mark.parametrize("name", ["wander", "teleop", "herbert"])
def test_a_behavior_for_any_robot_is_for_rome_where_no_project_says_otherwise(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert library.load(name).robot.name == "rome"
    other = (ROOT / "robots" / "rome" / "rome.colony").read_text().replace("robot rome {", "robot other {")
    (tmp_path / "other.colony").write_text(other)
    assert library.load(name, robot="./other.colony").robot.name == "other"
    (tmp_path / "colony.toml").write_text('robot = "./other.colony"')
    assert library.load(name).robot.name == "other"


def test_what_comes_with_colony_is_listed_for_a_name_like_none(colony: Colony) -> None:
    assert "behaviors that come with colony: allen, bounce, corridor, " in colony.refusal("check", "nosuch")


def test_a_recording_has_files_of_ones_own_and_those_that_come_with_colony(
    colony: Colony, tmp_path: Path
) -> None:
    """Both are called wander.colony: the one that teleop.colony imports is not the one beside the program."""
    (tmp_path / "wander.colony").write_text(OWN)
    (tmp_path / "user.colony").write_text(USER)
    places = [place for place, _ in library.load(tmp_path / "user.colony").files]
    assert sorted(places) == [
        *(f"colony.shipped/{name}.colony" for name in ("functions", "rome", "teleop", "wander")),
        *("user.colony", "wander.colony"),
    ]
    colony.output("run", "user.colony", "--map", "loop", "--duration", "1", "--record", "run.mcap")
    for name in ("user.colony", "wander.colony"):
        (tmp_path / name).unlink()
    assert colony("audit", "run.mcap").code == 0
