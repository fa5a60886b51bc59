"""`colony map`."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.conftest import Colony
from tests.paths import MAPS


def test_the_ending_says_which_format(colony: Colony, tmp_path: Path) -> None:
    assert "drawn in hallway.png" in colony.output("map", MAPS / "hallway.stickrep")
    assert (tmp_path / "hallway.png").read_bytes().startswith(b"\x89PNG")
    err = colony.one_line("map", MAPS / "loop.stickrep", "-o", "l.pdf")
    assert "expected a file ending in .png or .svg" in err


def test_a_summary_for_programs(colony: Colony, tmp_path: Path) -> None:
    summary = json.loads(colony.output("map", MAPS / "loop.stickrep", "--format", "json", "--no-picture"))
    assert summary["lights"] == 20
    assert [ring["name"] for ring in summary["rings"]] == ["outline", "block"]
    assert summary["picture"] is None
    assert not (tmp_path / "loop.png").exists()


def test_links_floors_and_elevators(colony: Colony) -> None:
    code, out, err = colony("map", MAPS / "msu_engineering_3.stickrep", "--no-picture")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].startswith("msu_engineering_3, floor 3: 124.0 m by 116.0 m; doors: 108, elevators: 2, ")
    assert lines[-4:] == [
        "  links: 34; a path may lead over all rings",
        "  paths keep the wall on the left",
        "  elevator acs.elev.L of floor 3 is acs.elev.L of floor 2 (msu_engineering_2)",
        "  elevator old.elev.L of floor 3 is old.elev.L of floor 2 (msu_engineering_2)",
    ]


def test_links_floors_and_elevators_for_programs(colony: Colony) -> None:
    path = MAPS / "msu_engineering_2.stickrep"
    summary = json.loads(colony("map", path, "--no-picture", "--format", "json").out)
    assert (summary["floor"], summary["travel"], summary["links"]) == ("2", "wall-on-left", 16)
    assert summary["linked_rings"] == [["1", "2", "3"]]
    assert summary["other_floors"] == [{"map": "msu_engineering_3", "floor": "3"}]
    assert summary["rides"][0] == {
        "from": {"map": "msu_engineering_2", "node": "acs.elev.L"},
        "to": {"map": "msu_engineering_3", "node": "acs.elev.L"},
    }


def test_the_other_floors_are_checked(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "alone.stickrep").write_text((MAPS / "msu_engineering_2.stickrep").read_text())
    assert colony.refusal("map", "alone.stickrep").count("error[M029]") == 2


def test_a_bad_map_gets_all_its_errors_with_their_places(colony: Colony, tmp_path: Path) -> None:
    text = (MAPS / "hallway.stickrep").read_text()
    (tmp_path / "bad.stickrep").write_text(text.replace("101L    D", "101L    X").replace("103R ", "103L "))
    err = colony.refusal("map", "bad.stickrep")
    assert "bad.stickrep:28:18: error[M011]" in err
    assert "error[M014]" in err
    assert "^" in err
    assert list(tmp_path.glob("*.png")) == []


def test_a_map_that_cannot_be_read(colony: Colony, tmp_path: Path) -> None:
    for path in ("nowhere.stickrep", "."):
        err = colony.one_line("map", path)
        assert err.startswith(f"{path}:1:1: error[M001]: cannot read the map")


def test_a_picture_that_cannot_be_written(colony: Colony) -> None:
    err = colony.refusal("map", MAPS / "loop.stickrep", "-o", "no/where.png")
    assert err == "no/where.png: error: cannot write: the folder does not exist\n"


def test_a_grid_is_summarized_and_drawn_beside_its_image(colony: Colony, tmp_path: Path) -> None:
    code, out, err = colony("map", "office")
    assert (code, err) == (0, "")
    first, areas, start, *docks, drawn = out.splitlines()
    assert first == "office: 26.6 m by 21.5 m; 532 x 430 cells of 50 mm"
    assert areas.startswith("  free: 456.4 m2, occupied: 33.9 m2, unknown: 81.6 m2; walls: ")
    assert start == "  start of a robot with a radius of 400 mm at (0.00 m, 0.00 m), heading 270 degrees"
    assert docks == [
        "  dock at (3.00 m, -0.75 m), heading 180 degrees",
        "  dock at (10.50 m, -13.25 m), heading 180 degrees",
    ]
    assert drawn == "  drawn in office_map.png"
    assert (tmp_path / "office_map.png").read_bytes().startswith(b"\x89PNG")


def test_a_grid_for_programs(colony: Colony) -> None:
    summary = json.loads(colony("map", MAPS / "office.yaml", "--no-picture", "--format", "json").out)
    assert (summary["cells"], summary["cell_mm"]) == ([532, 430], 50.0)
    assert summary["image"] == str(MAPS / "office.png")
    assert summary["start"] == {"x_mm": 0.0, "y_mm": 0.0, "heading_deg": 270.0}
    assert round(sum(summary["area_m2"].values()), 1) == 571.9


def test_the_image_of_a_grid_is_not_overwritten(colony: Colony, tmp_path: Path) -> None:
    for name in ("office.yaml", "office.png"):
        (tmp_path / name).write_bytes((MAPS / name).read_bytes())
    before = (tmp_path / "office.png").read_bytes()
    code, _, err = colony("map", "office.yaml", "-o", "office.png")
    assert (code, err) == (2, "office.png: error: cannot write: it is an input of this command\n")
    assert (tmp_path / "office.png").read_bytes() == before
