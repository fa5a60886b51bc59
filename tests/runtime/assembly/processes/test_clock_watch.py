"""How long a Clock may be absent from a run, in seconds that the tests give."""

from __future__ import annotations

import pytest

from colony.runtime.assembly.processes.window import GIVE_UP_AFTER_S, REPORT_AFTER_S, ClockWatch


@pytest.fixture
def reports() -> list[str]:
    return []


@pytest.fixture
def watch(reports: list[str]) -> ClockWatch:
    return ClockWatch("rome", reports.append)


def test_a_short_absence_is_not_reported(watch: ClockWatch, reports: list[str]) -> None:
    watch.note(False, 10.0)
    assert watch.check(10.0 + REPORT_AFTER_S - 0.1) is None
    watch.note(True, 12.0)
    assert watch.absent_s(100.0) == 0.0
    assert watch.check(100.0) is None
    assert reports == []


def test_a_long_one_is_reported_once_and_so_is_its_end(watch: ClockWatch, reports: list[str]) -> None:
    watch.note(False, 10.0)
    for now_s in (12.0, 13.0, 14.0):
        assert watch.check(now_s) is None
    watch.note(True, 15.0)
    for now_s in (15.0, 16.0):
        assert watch.check(now_s) is None
    assert reports == [
        "rome does not answer: its Clock does not run; waiting up to 30 s for it",
        "rome answers again, after 5.0 s",
    ]


def test_the_run_fails_when_the_clock_stays_absent(watch: ClockWatch) -> None:
    watch.note(False, 10.0)
    watch.note(False, 20.0)  # noted again, it is absent since the first time
    assert watch.check(10.0 + GIVE_UP_AFTER_S - 0.1) is None
    assert watch.check(10.0 + GIVE_UP_AFTER_S) == "rome has not answered for 30 s: its Clock does not run"


def test_frames_extend_the_life_of_the_clock_by_their_length(watch: ClockWatch, reports: list[str]) -> None:
    watch.note_frames(5.0, 5.0)
    assert watch.absent_s(6.0) == 0.0
    watch.note(False, 10.0)
    for now_s in (10.5, 11.0, 11.5, 12.0, 12.5):  # it runs, although it is not present
        watch.note_frames(0.5, now_s)
        assert watch.check(now_s) is None
    assert watch.absent_s(12.5) == 0.0
    assert reports == []


def test_an_old_frame_that_is_shown_late_is_no_sign_of_life(watch: ClockWatch, reports: list[str]) -> None:
    """The observer handles the last verdicts with the next message of anybody, such as `colony ps`."""
    watch.note(False, 10.0)
    assert watch.check(13.0) is None
    watch.note_frames(0.05, 14.0)
    assert watch.check(14.0) is None
    assert watch.absent_s(14.0) == pytest.approx(3.95)
    assert reports == ["rome does not answer: its Clock does not run; waiting up to 30 s for it"]
    assert watch.check(10.1 + GIVE_UP_AFTER_S) is not None
