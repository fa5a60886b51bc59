from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.maps.source import MAX_BYTES
from colony.nav.maps.stickrep.model import EdgeKind, Map, MapLight, Pose
from colony.nav.maps.stickrep.reader import load_map, read_map
from colony.text.diagnostics import DiagnosticError, headline, render
from colony.text.source import Source
from tests.diagnostics import place_of, problems_of
from tests.nav.maps.small_maps import HEADER, ROOM
from tests.paths import MAPS

INCH = 25.4


def read(text: str) -> Map:
    return read_map(Source("room.stickrep", text))


def found(text: str) -> list[str]:
    """Line, column and code of everything that is wrong with a text."""
    problems = problems_of(read, text)
    assert all(map(render, problems))
    return [f"{place_of(d)} {d.code}" for d in problems]


def test_a_room() -> None:
    room = read(ROOM)
    assert room.name == "room"
    assert room.start == Pose(50 * INCH, 50 * INCH, 0.0)
    (ring,) = room.rings
    assert [n.name for n in ring.nodes] == ["A", "B", "C", "D"]
    assert all(n.corner and n.angle_deg == 270.0 and n.turn_deg == -90.0 for n in ring.nodes)
    assert [e.length_mm for e in ring.edges] == [100 * INCH, 120 * INCH, 100 * INCH, 120 * INCH]
    assert ring.edges[1].lights == (MapLight(offset_mm=60 * INCH),)
    assert ring.edges[2].kind is EdgeKind.DOOR
    assert ring.edges[2].attribute == "glass"
    assert ring.path_length_mm == 440 * INCH


@pytest.mark.parametrize("name", ["hallway", "loop"])
def test_the_maps_that_come_along_are_sound(name: str) -> None:
    loaded = load_map(MAPS / f"{name}.stickrep")
    assert loaded.name == name
    assert loaded.count(EdgeKind.DOOR) >= 4
    assert loaded.count(EdgeKind.ELEVATOR) == 1


def test_lights_are_incremental_unless_the_header_says_cumulative() -> None:
    row = "-270 B W 2 10 30 120 brick"
    text = ROOM.replace("-270 B W 1 60 120 brick", row)
    assert [x.offset_mm / INCH for x in read(text).rings[0].edges[1].lights] == pytest.approx([10, 40])
    cumulative = text.replace("start", "lights cumulative\nstart")
    assert [x.offset_mm / INCH for x in read(cumulative).rings[0].edges[1].lights] == pytest.approx([10, 30])


def test_negative_fields() -> None:
    text = ROOM.replace("-270 A W 0 100", "-270 A W 1 -90 -100").replace("B W 1 60", "B W 1 -10")
    ring = read(text).rings[0]
    assert ring.edges[0].lights == (MapLight(offset_mm=90 * INCH, shared=True),)
    assert not ring.edges[0].counted
    assert ring.path_length_mm == 340 * INCH


def test_a_shared_light_may_be_exactly_at_a_node() -> None:
    text = ROOM.replace("-270 A W 0 100", "-270 A W 1 -100 100").replace("B W 1 60", "B W 1 -0")
    assert read(text).rings[0].edges[1].lights == (MapLight(offset_mm=0.0, shared=True),)


def test_units_comments_and_order_of_the_header() -> None:
    text = "# a room\nstickrep 1 # version\nstart 1 1 370 \n".replace("370", "350") + (
        "ring r 0 0 0\n270 A W 0 2 x # brick\n270 B W 0 2\n270 C W 0 2\n270 D W 0 2\nunit m\nmap m\n"
    )
    room = read(text)
    assert room.rings[0].edges[0].length_mm == 2000.0
    assert room.rings[0].edges[0].attribute == "x"
    assert room.start == Pose(1000.0, 1000.0, 350.0)
    assert room.unit == "m"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ["1:1 M003"]),
        ("  # nothing\n\n", ["1:1 M003"]),
        ("hello world", ["1:1 M003"]),
        ("stickrep\n", ["1:1 M003"]),
        ("stickrep 2\n", ["1:10 M003"]),
        ("stickrep 1\n", ["1:11 M006"] * 3),
        ("stickrep 1\nmap a\nstart 0 0 0\n180 A W 0 3 x\n", ["4:1 M013", "4:14 M006"]),
        (ROOM.replace("map room", "map ro/om"), ["2:5 M008"]),
        (ROOM.replace("map room", "mapp room"), ["2:1 M004", "8:21 M006"]),
        (ROOM.replace("map room", "map room\nmap room"), ["3:1 M005"]),
        (ROOM.replace("start 50 50 0", "start 50 50"), ["3:12 M007"]),
        (ROOM.replace("start 50 50 0", "start 50 50 0 0"), ["3:15 M007"]),
        (ROOM.replace("start 50 50 0", "start 50 x 0"), ["3:10 M009"]),
        (ROOM.replace("start 50 50 0", "start 50 50 361"), ["3:13 M009"]),
        (ROOM.replace("start 50 50 0", "start 500 50 0"), ["3:7 M022"]),
        (ROOM.replace("start", "unit parsec\nstart"), ["3:6 M007"]),
        (ROOM.replace("start", "unit deg\nstart"), ["3:6 M007"]),
        (ROOM.replace("start", "lights up\nstart"), ["3:8 M007"]),
        (ROOM.replace("start", "closure -1\nstart"), ["3:9 M007"]),
        (ROOM.replace("ring outline", "ring out line"), ["4:19 M007"]),
        (ROOM.replace("-270 A", "270x A"), ["5:1 M009"]),
        (ROOM.replace("-270 A", "0 A"), ["5:1 M009"]),
        (ROOM.replace("-270 A", "360 A"), ["5:1 M009"]),
        (ROOM.replace("-270 A", "-180 A"), ["5:1 M009"]),
        (ROOM.replace("-270 A", "1e999 A"), ["5:1 M009"]),
        (ROOM.replace("-270 A", "nan A"), ["5:1 M004"]),
        (ROOM.replace(" A W 0 100 brick", " A W 0"), ["5:11 M010"]),
        (ROOM.replace("-270 A", "-270 a,b"), ["5:6 M008"]),
        (ROOM.replace("A W 0", "A V 0"), ["5:8 M011"]),
        (ROOM.replace("A W 0", "A w 0"), ["5:8 M011"]),
        (ROOM.replace("A W 0", "A W 1"), ["5:16 M012"]),
        (ROOM.replace("A W 0", "A W 0.5"), ["5:10 M009"]),
        (ROOM.replace("A W 0", "A W -1"), ["5:10 M009"]),
        (ROOM.replace("A W 0", "A W 99999999999999999999"), ["5:10 M009"]),
        (ROOM.replace("A W 0 100", "A W 0 0"), ["5:12 M009"]),
        (ROOM.replace("A W 0 100", "A W 0 1e9"), ["5:12 M009"]),
        (ROOM.replace("-270 B", "-270 A"), ["6:6 M014"]),
        (ROOM.replace("B W 1 60", "B W 1 121"), ["6:12 M019"]),
        (ROOM.replace("B W 1 60", "B W 1 -60"), ["6:12 M020"]),
        (ROOM.replace("-270 D W", "-90 D W"), ["4:1 M017"]),
        (ROOM.replace("D W 0 120", "D W 0 124"), ["4:1 M018"]),
        (ROOM.replace("start", "lights cumulative\nstart").replace("1 60", "2 60 50"), ["7:15 M019"]),
        (HEADER + "ring r 0 0 0\n270 A W 0 9 x\n270 B W 0 9 x\n", ["4:1 M016"]),
    ],
)
def test_errors_are_located(text: str, expected: list[str]) -> None:
    assert found(text) == expected


def test_everything_wrong_is_reported_at_once_and_in_order() -> None:
    text = (
        ROOM.replace("start 50", "start x").replace("A W 0 100", "A X 0 -").replace("D W 0 120", "D W 9 120")
    )
    assert found(text) == ["3:7 M009", "5:8 M011", "5:12 M009", "8:21 M012"]


def test_messages_say_what_was_found_and_what_was_expected() -> None:
    (error,) = problems_of(read, ROOM.replace("D W 0 120", "D W 0 124"))
    assert headline(error) == (
        "room.stickrep:4:1: error[M018]: ring `outline` ends 102 mm from where it began"
        "; expected at most 51 mm"
    )
    assert "4.0 inch" in error.hint


def test_a_typo_in_the_header_gets_a_suggestion() -> None:
    assert hints(ROOM.replace("start", "strat"))[0] == "did you mean `start`?"


def test_a_tolerance_lets_a_ring_miss_its_beginning() -> None:
    text = ROOM.replace("D W 0 120", "D W 0 124")
    assert read(text.replace("start", "closure 4\nstart")).tolerance_mm == 4 * INCH
    exact = ROOM.replace("start", "closure 0\nstart")
    assert read(exact).tolerance_mm == 0.0


def test_two_rings_may_not_share_a_name_or_cross() -> None:
    block = "ring {name} 20 20 270\n90 P W 0 {side} x\n90 Q W 0 30 x\n90 R W 0 {side} x\n90 S W 0 30 x\n"
    apart = ROOM + block.format(name="block", side=30)
    assert found(apart.replace("start 50 50", "start 30 30")) == ["3:7 M022"]
    assert len(read(apart.replace("start 50 50", "start 60 60")).rings) == 2
    assert found(ROOM + block.format(name="outline", side=30)) == ["9:6 M015"]
    assert found(ROOM + block.format(name="block", side=120)) == ["10:4 M021", "12:4 M021"]


def test_a_ring_traced_the_wrong_way_round() -> None:
    backward = HEADER + "ring r 0 0 270\n90 A W 0 99\n90 B W 0 99\n90 C W 0 99\n90 D W 0 99\n"
    assert found(backward) == ["4:1 M024"]


def test_files_that_are_no_maps(tmp_path: Path) -> None:
    def code(path: str | os.PathLike[str]) -> str:
        first = problems_of(load_map, path)[0]
        assert render(first).startswith(os.fspath(path))
        return first.code

    assert code(tmp_path) == "M001"
    assert code(tmp_path / "nowhere.stickrep") == "M001"
    assert code("with\0nul") == "M001"
    file = tmp_path / "odd.stickrep"
    cases = [
        (b"", "M003"),
        (b"stickrep 1\n\0\0", "M002"),
        (b"stickrep 1\n\xff\xfe", "M002"),
        (bytes(range(256)) * 40_000, "M002"),
        (b"x" * (MAX_BYTES + 1), "M002"),
        (b"stickrep 1\n" + b"garbage 1 2 3\n" * 200_000, "M004"),
        (b"stickrep 1\nring r 0 0 0\n" + b"180 A W 0 1 x\n" * 200_000, "M023"),
        (b"stickrep 1\n" + b"9" * 3_000_000, "M013"),
    ]
    for data, expected in cases:
        file.write_bytes(data)
        assert code(file) == expected


def test_an_invalid_byte_is_located(tmp_path: Path) -> None:
    file = tmp_path / "latin.stickrep"
    file.write_bytes("stickrep 1\nmap caf\u00e9\n".encode("latin-1"))
    assert headline(problems_of(load_map, file)[0]).startswith(f"{file}:2:8: error[M002]: byte 0xe9 ")


@given(st.text(alphabet="-0123456789. ABWDE\nring#e", max_size=200))
def test_any_text_is_a_map_or_a_located_failure(text: str) -> None:
    with suppress(DiagnosticError):
        assert read(ROOM + text).name == "room"


joint_words = st.sampled_from(
    [*"link elevator floor travel A B C+30 p0 p1+10 p2 + A+ +1 1e9".split(), "x y", "\n"]
)


@given(st.lists(joint_words, max_size=12))
def test_any_links_and_elevators_are_a_map_or_a_located_failure(words: list[str]) -> None:
    block = "ring block 40 40 270\n" + "".join(f"90 p{i} W 0 20\n" for i in range(4))
    text = ROOM + block + "link " + " ".join(words)
    try:
        read(text)
    except DiagnosticError as failure:
        for problem in failure.diagnostics:
            assert problem.span.source.text == text
            assert render(problem)


def test_a_pipe_is_refused_rather_than_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.stickrep"
    os.mkfifo(pipe)
    with pytest.raises(DiagnosticError, match=r"pipe\.stickrep:1:1: error\[M001\].*not a regular file"):
        load_map(pipe)


def hints(text: str) -> list[str | None]:
    return [d.hint for d in problems_of(read, text)]


def test_two_outlines_that_overlap_are_told_apart_from_one_that_is_traced_backward() -> None:
    room = "-270 {0}1 W 0 100\n-270 {0}2 W 0 100\n-270 {0}3 W 0 100\n-270 {0}4 W 0 100\n"
    slid = HEADER + "ring a 0 0 0\n" + room.format("a") + "ring b 20 0 0\n" + room.format("b")
    assert found(slid) == ["9:1 M024"]
    assert "two outlines must not overlap" in str(hints(slid))
    backward = HEADER + "ring a 0 0 270\n" + room.format("a").replace("-270", "90")
    assert "an outline is traced clockwise" in str(hints(backward))


def test_a_text_with_the_line_ends_of_another_age() -> None:
    text = "# a map\n" + ROOM
    assert read(text.replace("\n", "\r\n")) == read(ROOM)
    assert found(text.replace("\n", "\r")) == ["1:1 M003"]
    assert "CR alone" in str(hints(text.replace("\n", "\r")))
    assert "CR alone" not in str(hints("# only\n# comments\n"))
