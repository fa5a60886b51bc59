"""Problems are reported once each; parts fail until they had no problem for a while."""

from __future__ import annotations

import pytest

from colony.runtime.kit.once import (
    MAX_FAILING,
    MAX_HEADLINE,
    RECOVERED_AFTER,
    OnceReporter,
    failure_text,
    headline,
)


@pytest.fixture
def reports() -> list[str]:
    return []


@pytest.fixture
def problems(reports: list[str]) -> OnceReporter:
    return OnceReporter(reports.append)


def test_each_kind_of_problem_is_reported_once(problems: OnceReporter, reports: list[str]) -> None:
    for name, kind in (("a", "x"), ("a", "x"), ("a", "y"), ("b", "x")):
        problems.report(name, kind, f"{name} {kind}")
    assert reports == ["a x", "a y", "b x"]


def test_a_part_fails_until_it_had_no_problem_for_some_frames(
    problems: OnceReporter, reports: list[str]
) -> None:
    assert problems.failing == ()
    problems.report("a", "x", "a fails")
    for _ in range(RECOVERED_AFTER):
        problems.end_frame()
    assert problems.failing == ("a fails",)
    problems.report("a", "x", "a fails again")
    for _ in range(RECOVERED_AFTER):
        problems.end_frame()
    assert problems.failing == ("a fails again",)
    problems.end_frame()
    assert problems.failing == ()
    problems.report("a", "x", "a fails once more")
    assert problems.failing == ("a fails once more",)
    assert reports == ["a fails"]


def test_a_success_ends_the_failure_of_its_part_alone(problems: OnceReporter) -> None:
    problems.report("a", "x", "a fails")
    problems.report("b", "x", "b fails")
    problems.note_success("a")
    problems.note_success("c")
    assert problems.failing == ("b fails",)


def test_few_parts_are_listed_with_a_line_each(problems: OnceReporter) -> None:
    for i in range(MAX_FAILING + 3):
        problems.report(str(i), "x", "long " * 100)
    assert len(problems.failing) == MAX_FAILING
    assert {len(line) for line in problems.failing} == {MAX_HEADLINE}


def test_the_headline_of_a_traceback_has_its_exception() -> None:
    try:
        raise ValueError("no bus")
    except ValueError as problem:
        text = failure_text("fields of Lidar", problem)
    assert "Traceback" in text
    assert headline(text) == "fields of Lidar failed: ValueError: no bus"
