"""docs/maps.md: every block is read, run or typed, and its tables leave nothing out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from colony.nav.maps.building import MAX_MAPS, load_building
from colony.nav.maps.source import MAX_BYTES
from colony.nav.maps.stickrep import fields
from colony.nav.maps.stickrep.connections import MAX_ACROSS_MM, MAX_DISPLACEMENT_MM, linked_rings
from colony.nav.maps.stickrep.fields import Problems
from colony.nav.maps.stickrep.header import Header
from colony.nav.maps.stickrep.model import DEFAULT_TOLERANCE_MM, EdgeKind
from colony.nav.maps.stickrep.reader import MAX_LINES, load_map, read_map
from colony.nav.maps.stickrep.writer import write_map
from colony.nav.maps.walls import lights_of, walls_of
from colony.text.codes import CODES
from colony.text.source import Source
from tests.pages import is_same_picture
from tests.test_other_codes import typed

DOCS = Path(__file__).parent.parent / "docs"
PAGE = (DOCS / "maps.md").read_text(encoding="utf-8")
FENCES = re.findall(r"^```([^\n]*)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
FILES = {info.split()[1]: text for info, text in FENCES if len(info.split()) == 2}
MAPS = [text for info, text in FENCES if info.startswith("stickrep")]


def only(kind: str) -> str:
    """The one block of a kind."""
    [text] = [text for info, text in FENCES if info == kind]
    return str(text)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The files that the page shows, in the current folder."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text)
    return tmp_path


def test_there_is_no_block_that_is_not_checked() -> None:
    assert {info.split()[0] for info, _ in FENCES} == {"stickrep", "sh", "text", "python"}


@pytest.mark.parametrize("text", MAPS, ids=lambda text: re.findall(r"^map +(\w+)", text, re.MULTILINE)[0])
def test_a_map_is_sound(text: str) -> None:
    shown = read_map(Source("shown.stickrep", text))
    assert read_map(Source("written.stickrep", write_map(shown))).rings == shown.rings


def test_the_command_prints_and_draws_what_is_shown(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert typed(only("sh").split(), monkeypatch) == (0, only("text"))
    assert "](corner.svg)" in PAGE
    assert is_same_picture(folder / "corner.svg", DOCS / "corner.svg")


def test_every_angle_of_the_drawing_is_in_its_map() -> None:
    [text] = [text for text in MAPS if "straight on" in text]
    [ring] = read_map(Source("turns.stickrep", text)).rings
    turns = {node.angle_deg: node.turn_deg for node in ring.nodes}
    assert turns == {180.0: 0.0, 270.0: -90.0, 90.0: 90.0}


def test_both_conventions_of_lights_give_one_map() -> None:
    one, other = (
        read_map(Source(name, FILES[name])) for name in ("incremental.stickrep", "cumulative.stickrep")
    )
    assert one.rings == other.rings


def test_the_light_of_the_turning_space(folder: Path) -> None:
    corner = load_map("corner.stickrep")
    [edge] = [e for n, e in zip(corner.rings[0].nodes, corner.rings[0].edges, strict=True) if n.name == "12R"]
    assert edge.lights[-1].offset_mm == pytest.approx(154 * 25.4)
    assert lights_of(corner)[-1] == pytest.approx([50 * 25.4, 350 * 25.4])


def test_the_python_block_says_what_it_gives(folder: Path) -> None:
    named: dict[str, Any] = {}
    exec(only("python"), named)
    for line in only("python").splitlines():
        expression, _, said = line.partition("  # ")
        if said.startswith(("[", "Landing", "13")):
            assert repr(eval(expression, named)) == said.partition(", the")[0]
    corner = load_map("corner.stickrep")
    assert f"# {corner.rings[0].path_length_mm}\n" in only("python")
    assert f"# {walls_of(corner).segments.shape}:" in only("python")
    assert f"# {lights_of(corner).shape}:" in only("python")
    assert corner.rings[0].path_length_mm / 25.4 == pytest.approx(1800)


def test_the_floors_of_the_example_lead_to_each_other(folder: Path) -> None:
    for name, other in (("ground", "upper"), ("upper", "ground")):
        assert [m.name for m in load_building(f"{name}.stickrep").maps] == [name, other]


def test_the_links_of_the_example_join_its_rings(folder: Path) -> None:
    linked = load_map("linked.stickrep")
    assert linked_rings(linked) == (("outline", "west", "east"),)
    assert lights_of(linked).round(6).tolist() == [[1000.0, 7000.0], [1000.0, 15000.0]]


def test_every_map_that_comes_along_is_listed() -> None:
    listed = re.findall(r"^\| \[(\w+)\]\(\.\./maps/\1\.stickrep\) \|", PAGE, re.MULTILINE)
    assert sorted(listed) == sorted(path.stem for path in (DOCS.parent / "maps").glob("*.stickrep"))


def test_every_line_of_the_header_is_listed() -> None:
    section = PAGE.partition("## Header")[2].partition("## Rings")[0]
    rows = re.findall(r"^\| `(\w+) ", section, re.MULTILINE)
    known = Header(Problems(), Source("none", "")).keywords
    assert sorted([*rows, "link", "elevator"]) == sorted(known)


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


def test_every_check_of_maps_is_told() -> None:
    pages = PAGE + (DOCS / "grids.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\((M\d{3})\)", pages)) == {code for code in CODES if code.startswith("M")}
