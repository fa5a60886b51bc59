from __future__ import annotations

import pytest

from colony.nav.maps.stickrep.fields import Problems, lines_of_words
from colony.nav.maps.stickrep.header import Header
from colony.text.source import Source


def header(text: str) -> tuple[Header, list[bool]]:
    """What a header says, and which of its lines were taken."""
    source = Source("h.stickrep", text)
    read = Header(Problems(), source)
    return read, [read.read_line(words) for words in lines_of_words(source)]


def test_lines_in_any_order() -> None:
    read, taken = header("travel wall-on-left\nunit m\nfloor B1\nlights cumulative\nmap house\nclosure 3\n")
    assert taken == [True] * 6
    assert (read.travel, read.unit, read.floor, read.light_offsets, read.name) == (
        "wall-on-left",
        "m",
        "B1",
        "cumulative",
        "house",
    )
    assert read.tolerance.text == "3"
    assert not read.problems


def test_rings_and_rows_are_left() -> None:
    read, taken = header("ring a 0 0 0\n180 A W 0 3\n-90 B W 0 3\nlink A B\nlink C D+1\n")
    assert taken == [False, False, False, True, True]
    assert [[word.text for word in link] for link in read.links] == [["A", "B"], ["C", "D+1"]]


@pytest.mark.parametrize(
    ("text", "code", "hint"),
    [
        ("trevel either", "M004", "did you mean `travel`?"),
        ("lnk A B", "M004", "did you mean `link`?"),
        (
            "qqqq",
            "M004",
            "header lines are: map, floor, start, unit, lights, closure, travel, link, elevator, hole, dock",
        ),
        ("travel both", "M007", "paths follow the rings both ways (either), or only as these are traced"),
        ("floor", "M007", None),
        ("floor 1 2", "M007", None),
        ("floor 1/2", "M008", "a name is"),
        ("link A", "M007", None),
        ("link A B C", "M007", None),
        ("floor 1\nfloor 2", "M005", "remove one"),
        ("elevator a b c\nelevator a  b c", "M005", "remove one"),
    ],
)
def test_what_is_wrong(text: str, code: str, hint: str | None) -> None:
    read, _ = header(text)
    (problem,) = read.problems
    assert problem.code == code
    assert (problem.hint is None) == (hint is None)
    assert hint is None or (problem.hint or "").startswith(hint)
