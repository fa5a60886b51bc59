"""Records of plate finders: kept and read back, counted, and put into tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from colony.experiment.results import Results, RunKey
from studies.confidence.estimate import Count
from studies.lists import plate_list
from studies.plates.figures import events, plate_targets, taken_for_plates, total, walks
from studies.plates.record import PLATE_TABLE, Finder, Kind, Outcome, PlateResult, Tally
from studies.plates.tables import plate_tables
from studies.record import RUN_TABLE
from tests.studies.stage import REACHED


def _outcome(kind: Kind, at_s: float, name: str = "352", *, right: bool = True) -> Outcome:
    return Outcome(kind, round(at_s * 1e9), name, "352", right and kind == "found", 100, -200)


CLEAN = tuple(_outcome("found", at) for at in range(1, 101))
SPOILT = (
    _outcome("found", 1),
    _outcome("missed", 2, "354"),
    _outcome("found", 3, right=False),
    _outcome("false", 4, "a black poster"),
    _outcome("false", 4.5, "352 again"),
    _outcome("missed", 5, "356"),
    _outcome("unseen", 6, "358"),
    _outcome("beyond", 7, "360"),
)


def _result(number: int = 1, **outcomes: tuple[Outcome, ...]) -> PlateResult:
    select: dict[Finder, tuple[Outcome, ...]] = {"thesis": SPOILT, "ours": CLEAN, "map": CLEAN}
    return PlateResult(
        key=RunKey("plates", number, 1, "ours"), origin="352L", goal="384R", failure="", time_s=100.5,
        outcomes={finder: outcomes.get(finder, told) for finder, told in select.items()},
    )  # fmt: skip


def test_records_come_back_as_they_were_beside_others(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    kept = [_result(), replace(_result(2), failure="stuck")]
    with Results(path, PLATE_TABLE) as results, Results(path, RUN_TABLE) as others:
        for one in kept:
            results.put(one)
        others.put(REACHED)
    with Results(path, PLATE_TABLE) as results, Results(path, RUN_TABLE) as others:
        assert results.select("plates", "ours") == tuple(kept)
        assert others.select("thesis", "ours") == (REACHED,)


def test_counts() -> None:
    results = [_result(), _result(2)]
    assert total(results, "thesis") == Tally(found=4, missed=4, unseen=2, right=2, false=4)
    assert total(results, "thesis").due == 8
    assert total([], "ours") == Tally(0, 0, 0, 0, 0)
    assert walks(results, "thesis") == ("DMDPPMM", "DMDPPMM")
    assert taken_for_plates(results, "thesis") == {"a black poster": 2, "a plate again": 2}
    counted = events(results, "thesis")
    assert (counted["E2"], counted["E5"], counted["E9"]) == (Count(6, 10), Count(2, 10), Count(2, 10))


def test_targets_are_met_and_missed() -> None:
    assert [target.met for target in plate_targets([_result()])] == [True] * 6
    assert not any(target.met for target in plate_targets([]))
    one_false = (*CLEAN, _outcome("false", 200, "a person"))
    met = [target.met for target in plate_targets([_result(ours=one_false, map=one_false)])]
    assert met == [True, True, True, False, True, True]
    two_false = (*one_false, _outcome("false", 201, "a person"))
    assert not plate_targets([_result(ours=two_false)])[1].met
    missed = tuple(one._replace(kind="missed") for one in CLEAN[:2])
    met = [target.met for target in plate_targets([_result(ours=CLEAN[2:] + missed, map=CLEAN[2:] + missed)])]
    assert met[:3] == [True, True, False]
    misread = tuple(one._replace(right=False) for one in CLEAN[:2])
    assert not plate_targets([_result(ours=misread + CLEAN[2:])])[4].met


def test_tables_have_ours_beside_the_published() -> None:
    tables = plate_tables(plate_list(), [_result(map=SPOILT)])
    text = "\n\n".join(tables)
    [row] = [line for line in text.splitlines() if line.startswith("| 1    | 352L")]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[3:] == ["1/1", "100", "0", "2, 2, 2", "100, 0, 0", "2, 2, 2", "12, 2, 1"]
    assert "100 of 100, 1.0000 (0.9638 to 1.0000)" in text
    assert "143 of 162, 0.8827" in text
    assert "| a black poster" in text
    for row in ("| E5 ", "| E9 "):
        [line] = [line for line in text.splitlines() if line.startswith(row)]
        assert line.endswith("/162   |") or "/162" in line.split("|")[-2]
    assert "read as 352" in text


@pytest.mark.parametrize("results", [[], [_result(ours=(), map=(), thesis=())]])
def test_nothing_to_tell_is_told(results: list[PlateResult]) -> None:
    text = "\n\n".join(plate_tables(plate_list(), results))
    assert ("**missed**" in text) == bool(results)
