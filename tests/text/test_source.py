"""Places in texts: offsets to lines and columns and back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.text.source import NOWHERE, Source, Span


@pytest.mark.parametrize(
    ("offset", "place"),
    [
        (0, (1, 1)),
        (1, (1, 2)),
        (2, (1, 3)),
        (3, (2, 1)),
        (4, (3, 1)),
        (7, (3, 4)),
        (99, (3, 4)),
        (-5, (1, 1)),
    ],
)
def test_positions(offset: int, place: tuple[int, int]) -> None:
    assert Source("x", "ab\n\ncde").position(offset) == place


def test_lines_come_without_their_ends() -> None:
    source = Source("x", "ab\r\n\ncde")
    assert [source.line(i) for i in (1, 2, 3)] == ["ab", "", "cde"]


def test_an_empty_text_has_one_line() -> None:
    source = Source("x", "")
    assert source.position(0) == (1, 1)
    assert source.line(1) == ""


def test_spans() -> None:
    source = Source("a.colony", "let a = 3\nlet b = 4")
    first, second = Span(source, 4, 5), Span(source, 14, 15)
    assert first.text == "a"
    assert first.to(second).text == "a = 3\nlet b"
    assert repr(second) == "a.colony:2:5"
    assert repr(source) == "Source('a.colony')"
    assert NOWHERE.text == ""


@given(st.text(alphabet="ab\n\r"), st.data())
def test_a_position_leads_back_to_its_character(text: str, data: st.DataObject) -> None:
    source = Source("x", text)
    offset = data.draw(st.integers(0, len(text)))
    line, column = source.position(offset)
    lines = text.split("\n")
    assert sum(len(one) + 1 for one in lines[: line - 1]) + column - 1 == offset
    assert source.line(line) == lines[line - 1].rstrip("\r")
