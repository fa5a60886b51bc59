"""The maps on docs/maps.md and docs/grids.md are read, and tables and numbers are those of the readers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from colony.nav.maps.building import MAX_MAPS, load_building
from colony.nav.maps.grid import keys
from colony.nav.maps.grid.outlines import MAX_SIDES
from colony.nav.maps.grid.reader import FORMATS, MAX_CELLS, MAX_IMAGE_BYTES, MAX_YAML_BYTES
from colony.nav.maps.source import MAX_BYTES
from colony.nav.maps.stickrep import fields
from colony.nav.maps.stickrep.checks import MAX_ACROSS_MM, MAX_DISPLACEMENT_MM, linked_rings
from colony.nav.maps.stickrep.fields import Problems
from colony.nav.maps.stickrep.header import Header
from colony.nav.maps.stickrep.model import DEFAULT_TOLERANCE_MM, EdgeKind
from colony.nav.maps.stickrep.reader import MAX_LINES, load_map, read_map, write_map
from colony.nav.maps.walls import lights_of
from colony.nav.maps.world_map import MAX_WALLS
from colony.text.codes import CODES
from colony.text.source import Source
from tests.pages import Block, blocks, page_text, write_files
from tests.paths import MAPS

PAGE, GRIDS = page_text("maps.md"), page_text("grids.md")
SHOWN = [block for block in blocks("maps.md") if block.info.startswith("stickrep")]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The files that the page shows, in the current folder."""
    monkeypatch.chdir(tmp_path)
    write_files("maps.md", tmp_path)
    return tmp_path


@pytest.mark.parametrize("block", SHOWN, ids=str)
def test_a_map_is_sound(block: Block) -> None:
    shown = read_map(Source("shown.stickrep", block.text))
    assert read_map(Source("written.stickrep", write_map(shown))).rings == shown.rings


def test_every_angle_of_the_drawing_is_in_its_map() -> None:
    [text] = [block.text for block in SHOWN if "straight on" in block.text]
    [ring] = read_map(Source("turns.stickrep", text)).rings
    turns = {node.angle_deg: node.turn_deg for node in ring.nodes}
    assert turns == {180.0: 0.0, 270.0: -90.0, 90.0: 90.0}


def test_both_conventions_of_lights_give_one_map(folder: Path) -> None:
    assert load_map("incremental.stickrep").rings == load_map("cumulative.stickrep").rings


def test_the_light_of_the_turning_space(folder: Path) -> None:
    corner = load_map("corner.stickrep")
    [edge] = [e for n, e in zip(corner.rings[0].nodes, corner.rings[0].edges, strict=True) if n.name == "12R"]
    assert edge.lights[-1].offset_mm == pytest.approx(154 * 25.4)
    assert lights_of(corner)[-1] == pytest.approx([50 * 25.4, 350 * 25.4])


def test_the_floors_of_the_example_lead_to_each_other(folder: Path) -> None:
    for name, other in (("ground", "upper"), ("upper", "ground")):
        assert [m.name for m in load_building(f"{name}.stickrep").maps] == [name, other]


def test_the_links_of_the_example_join_its_rings(folder: Path) -> None:
    linked = load_map("linked.stickrep")
    assert linked_rings(linked) == (("outline", "west", "east"),)
    assert lights_of(linked).round(6).tolist() == [[1000.0, 7000.0], [1000.0, 15000.0]]


def test_every_map_that_comes_along_is_listed() -> None:
    listed = re.findall(r"^\| \[(\w+)\]\(\.\./maps/\1\.stickrep\) \|", PAGE, re.MULTILINE)
    assert sorted(listed) == sorted(path.stem for path in MAPS.glob("*.stickrep"))


def test_every_line_of_the_header_is_listed() -> None:
    section = PAGE.partition("## Header")[2].partition("## Rings")[0]
    rows = re.findall(r"^\| `(\w+) ", section, re.MULTILINE)
    known = Header(Problems(), Source("none", "")).keywords
    assert sorted([*rows, "link", "elevator"]) == sorted(known)


def test_every_check_of_maps_is_told() -> None:
    assert set(re.findall(r"\((M\d{3})\)", PAGE + GRIDS)) == {code for code in CODES if code.startswith("M")}


def test_the_keys_are_those_of_the_office() -> None:
    [shown] = [block.text for block in blocks("grids.md") if block.info == "yaml"]
    kept = (MAPS / "office.yaml").read_text()
    assert shown == "".join(line for line in kept.splitlines(True) if not line.startswith("#"))
    keys.read_keys(Source("shown", shown))
    listed = re.findall(r"^\| `(\w+)` \|", GRIDS, re.MULTILINE)
    assert sorted(listed) == sorted(re.findall(r"^(\w+):", shown, re.MULTILINE))


def test_bounds_and_defaults_are_the_readers() -> None:
    assert f"at most {MAX_ACROSS_MM / 1000:g} m of it" in PAGE
    assert f"at most {MAX_DISPLACEMENT_MM / 1000:g} m along it" in PAGE
    assert f"at most {MAX_MAPS} maps" in PAGE
    assert f"at most {MAX_LINES} rows" in PAGE
    assert f"at most {MAX_BYTES // 1_000_000} MB" in PAGE
    assert f"at most {fields.MAX_LIGHTS} lights" in PAGE
    assert (fields.MIN_LENGTH_MM, fields.MAX_LENGTH_MM, fields.MAX_COORDINATE_MM) == (1.0, 1e6, 1e8)
    assert pytest.approx(2 * 25.4) == DEFAULT_TOLERANCE_MM
    [units] = re.findall(r"^\| `unit UNIT` .*: (.*) \| `inch` \|$", PAGE, re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", units)) == set(fields.LENGTH_UNITS)
    [types] = re.findall(r"^\| type .*$", PAGE, re.MULTILINE)
    assert set(re.findall(r"`(\w)`", types)) == {kind.value for kind in EdgeKind}


def test_bounds_of_grids_are_the_readers() -> None:
    far = keys.MAX_COORDINATE_M
    assert f"from {keys.MIN_CELL_M:g} to {keys.MAX_CELL_M:g}" in GRIDS
    assert f"at most {keys.MAX_DEPTH} deep" in GRIDS
    assert f"from -{far:g} to {far:g} ({far / 1000:g} km)" in GRIDS
    assert f"at most {keys.MAX_DOCKS:,} of them" in GRIDS
    assert f"at most {MAX_IMAGE_BYTES >> 20} MiB" in GRIDS
    assert f"at most {MAX_YAML_BYTES >> 10} KiB" in GRIDS
    sizes = f"at most {MAX_CELLS:,} cells, {MAX_SIDES:,} sides between occupied and other cells"
    sizes += f", and {MAX_WALLS:,} walls"
    assert sizes in GRIDS
    assert sizes in page_text("errors.md")
    assert all(name in GRIDS for name in FORMATS.values())
