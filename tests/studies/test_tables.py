"""Tables of results."""

from __future__ import annotations

from dataclasses import replace

from studies.confidence.tables import event_table, path_table, run_modes
from studies.lists import published_list
from studies.tables import clock_time, failure_table, table, target_table
from tests.studies.stage import REACHED, STUCK, result


def _cells(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]


def test_each_run_stands_beside_what_was_published_of_it() -> None:
    results = [result(1, 1), replace(result(1, 2), overshoot_mm=60.5), result(13, 1, STUCK)]
    head, rule, first, last = _cells(table(published_list(), results))
    assert set("".join(rule)) == {"-"}
    assert dict(zip(head[:12], first, strict=False)) == {
        "run": "1",
        "from": "350R",
        "to": "376L",
        "m": "78.2",
        "reached": "2/2",
        "beyond, median": "+0.02 m",
        "off, p95": "0.03 m",
        "time": "2:40",
        "m/min": "29.3",
        "L": "1/1",
        "C": "0/0",
        "D": "1/1",
    }
    assert first[12:] == ["-0.13 m", "5:26", "14.4", "1/1", "0/0", "1/1"]
    assert last[4:12] == ["0/1", "-", "-", "-", "-", "0/1", "0/0", "0/1"]
    assert last[12:] == ["failed", "", "", "0*/1", "0/0", "0/1"]


def test_lists_of_ones_own_have_no_published_columns() -> None:
    runs = [replace(run, published=None) for run in published_list()[:2]]
    head, _, row = _cells(table(runs, [result(2, 1)]))
    assert len(head) == len(row) == 12


def test_failures_are_listed_one_by_one() -> None:
    assert failure_table([REACHED]) == ""
    head, _, row = _cells(failure_table([REACHED, result(7, 9, STUCK)]))
    assert row == ["7", "9", "350R", "376L", "stuck", "L", "40.0 m", "2:40", "doors open: 2"]
    assert len(head) == len(row)


def test_missed_targets_stand_out() -> None:
    assert "**missed**" in target_table([STUCK], published=False)
    assert "**missed**" not in target_table([REACHED], published=False)


def test_times_are_written_as_published() -> None:
    assert [clock_time(s) for s in (0.0, 59.6, 326.0, 1951.4)] == ["0:00", "1:00", "5:26", "32:31"]


def test_confidence_is_counted_from_the_modes() -> None:
    results = [result(1, 1), result(1, 2), result(1, 3, STUCK)]
    assert [(m.modes, m.completed) for m in run_modes(results)] == [("ld", 2), ("ld", 2), ("ld", 0)]
    rows = {row[0]: row[1:] for row in _cells(event_table(results))[2:]}
    assert rows["the first light is found by a robot that has just started"][:2] == ["3 of 3", "1.0000"]
    followed = rows["the lights of a corridor are followed to the last one, once the first was found"]
    assert followed[:2] == ["2 of 3", "0.6667"]
    assert path_table(results) == ""  # nobody has passed a corner yet
    around = [replace(REACHED, planned_modes="lcld", completed=4)]
    assert _cells(path_table(around))[2][:3] == ["350R to 376L", "ld", "1.0000"]
