"""Findings as text and as JSON."""

from __future__ import annotations

import json

import pytest

from colony.text.diagnostics import (
    DiagnosticError,
    Label,
    error,
    has_errors,
    headline,
    in_order,
    note,
    render,
    to_json,
    warning,
)
from colony.text.source import Source, Span

SOURCE = Source("a.colony", "let a = 3\n\tlet bad = unknown + 1\n")
BAD = Span(SOURCE, 21, 28)


def test_the_headline() -> None:
    assert headline(error("E101", BAD, "unknown name")) == "a.colony:2:12: error[E101]: unknown name"
    assert headline(warning("W001", BAD, "unused")) == "a.colony:2:12: warning[W001]: unused"
    assert headline(note("W011", BAD, "the end")) == "a.colony:2:12: note[W011]: the end"


def test_notes_are_no_errors() -> None:
    assert not has_errors([note("W011", BAD, "the end"), warning("W001", BAD, "unused")])
    assert has_errors([note("W011", BAD, "the end"), error("E101", BAD, "unknown name")])
    [row] = json.loads(to_json([note("W011", BAD, "the end")]))
    assert row["severity"] == "note"


def test_the_source_line_has_a_caret_and_the_hint_follows() -> None:
    assert render(error("E101", BAD, "unknown name", "did you mean `a`?")) == (
        "a.colony:2:12: error[E101]: unknown name\n"
        "  2 |  let bad = unknown + 1\n"
        "    |            ^^^^^^^\n"
        "  hint: did you mean `a`?"
    )


def test_a_span_over_several_lines_is_marked_to_the_end_of_the_first() -> None:
    shown = render(error("E1", Span(SOURCE, 4, 28), "wrong"))
    assert shown.splitlines()[1:] == ["  1 | let a = 3", "    |     ^^^^^"]


def test_an_empty_span_has_one_caret() -> None:
    assert render(error("E1", Span(SOURCE, 9, 9), "wrong")).splitlines()[2] == "    |          ^"


def test_there_is_no_source_line_where_there_is_no_text() -> None:
    assert render(error("E1", Span(Source("x", ""), 0, 0), "wrong")) == "x:1:1: error[E1]: wrong"


def test_a_long_line_is_cut_around_the_place() -> None:
    text = "a" * 5000 + "HERE" + "b" * 5000
    shown = render(error("E1", Span(Source("x", text), 5000, 5004), "wrong"))
    _, line, carets = shown.splitlines()
    assert len(line) < 200
    start = carets.index("^")
    assert line[start : start + 4] == "HERE"
    assert carets.count("^") == 4


def test_control_characters_are_not_shown() -> None:
    source = Source("x", "\x1b[31m\x07\tbad")
    shown = render(error("E1", Span(source, 7, 10), "wrong"))
    assert "\x1b" not in shown
    assert "\x07" not in shown
    line, carets = shown.splitlines()[1:]
    assert line[carets.index("^") :] == "bad"


def test_json() -> None:
    [row] = json.loads(to_json([error("E101", BAD, "unknown name", "a hint")]))
    assert row == {
        "file": "a.colony",
        "line": 2,
        "column": 12,
        "end_line": 2,
        "end_column": 19,
        "severity": "error",
        "code": "E101",
        "message": "unknown name",
        "hint": "a hint",
        "labels": [],
    }


def test_another_place_is_shown_below() -> None:
    first = Label(Span(BAD.source, 0, 6), "first declared here")
    found = error("E102", BAD, "declared twice", "choose", first)
    shown = render(found).splitlines()
    assert shown[3] == "a.colony:1:1: note: first declared here"
    assert shown[5].endswith("| ^^^^^^")
    assert shown[6] == "  hint: choose"
    [row] = json.loads(to_json([found]))
    place = {"file": "a.colony", "line": 1, "column": 1, "end_line": 1, "end_column": 7}
    assert row["labels"] == [place | {"message": "first declared here"}]


def test_order_is_by_file_and_place_and_nothing_is_said_twice() -> None:
    other = Source("b.colony", "x y z")
    first = error("E1", Span(SOURCE, 5, 6), "later in a")
    second = error("E2", Span(other, 0, 1), "in b")
    third = error("E3", Span(SOURCE, 1, 2), "early in a")
    assert in_order([first, second, third, first]) == (third, first, second)
    same_place = error("E1", Span(SOURCE, 5, 9), "something else")
    assert in_order([first, same_place]) == (first, same_place)


def test_warnings_are_no_errors() -> None:
    assert not has_errors([])
    assert not has_errors([warning("W1", BAD, "hm")])
    assert has_errors([warning("W1", BAD, "hm"), error("E1", BAD, "no")])


def test_a_failure_carries_everything() -> None:
    failure = DiagnosticError([error("E1", BAD, "one"), error("E2", BAD, "two")])
    assert [d.code for d in failure.diagnostics] == ["E1", "E2"]
    with pytest.raises(DiagnosticError, match="two"):
        raise failure
