"""The pages of the studies have the columns, kinds, tables and totals."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from colony.sim.hazards.hazards import Hazards
from studies.catalog import PLATES, SOURCES
from studies.conduct import Experiment
from studies.confidence.published_plates import PUBLISHED_WALKS
from studies.lists import PUBLISHED_MAP, ListedRun, published_list
from studies.plates.record import FINDER_NAMES, PLATE_TABLE
from studies.record import RUN_TABLE, FailureReason
from studies.sources.run import NUMBERS
from tests.pages import page_text

EXPERIMENTS, PLATES_PAGE, SOURCES_PAGE = (
    page_text(f"studies/{name}.md") for name in ("experiments", "plates", "sources")
)


@pytest.mark.parametrize(
    ("page", "columns"), [(EXPERIMENTS, RUN_TABLE.columns), (PLATES_PAGE, PLATE_TABLE.columns)]
)
def test_every_column_is_explained(page: str, columns: tuple[str, ...]) -> None:
    explained = {f"{mode}_{what}" for mode in "cd" for what in ("entered", "completed", "needed")}
    assert not set(columns) - explained - set(re.findall(r"`([^`]+)`", page))


def test_every_failure_and_finder_is_explained() -> None:
    told = re.findall(r"^\| ([a-z ]+) \| [a-z]", EXPERIMENTS, re.MULTILINE)
    assert set(get_args(FailureReason)) - {""} <= set(told)
    assert all(f"\n| {name} | " in PLATES_PAGE for name in FINDER_NAMES.values())


@pytest.mark.parametrize(("page", "study"), [(PLATES_PAGE, PLATES), (SOURCES_PAGE, SOURCES)])
def test_the_command_at_the_top_is_that_of_the_study(page: str, study: object) -> None:
    [line] = re.findall(r"^    python -m studies (.*)$", page, re.MULTILINE)
    assert line.startswith(f"{study.name} --seeds {study.seeds} ")  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "name", "runs", "variant", "hazards"),
    [
        (PLATES_PAGE, PLATES.name, PLATES.runs(), "ours", Hazards()),
        (SOURCES_PAGE, SOURCES.name, SOURCES.runs(), "ours", Hazards()),
        (EXPERIMENTS, "thesis", published_list(), "thesis", Hazards()),
        (EXPERIMENTS, "thesis", published_list(), "ours", Hazards()),
        (EXPERIMENTS, "thesis", published_list(), "thesis", Hazards.none()),
    ],
)
def test_there_is_a_place_for_the_tables(
    text: str, name: str, runs: tuple[ListedRun, ...], variant: str, hazards: Hazards
) -> None:
    of = Experiment(
        name=name, map_path=PUBLISHED_MAP, runs=runs, seeds=(1,), variant=variant, hazards=hazards
    )
    begin, end = (f"<!-- {part}{name} {of.label} -->" for part in ("", "end of "))
    assert text.count(begin) == text.count(end) == 1
    assert text.index(begin) < text.index(end)


def test_the_published_totals_are_those_of_the_table() -> None:
    found, missed, false = (
        sum(len(part) for part in parts)
        for parts in zip(*((w.found, w.missed, w.false) for w in PUBLISHED_WALKS), strict=True)
    )
    assert f"{found} detected plates, {missed} missed and {false} false ones" in PLATES_PAGE


def test_the_page_of_the_sources_has_the_numbers_of_its_runs() -> None:
    assert [int(number) for number in re.findall(r"\((?:run )?(\d+)\)", SOURCES_PAGE)] == list(NUMBERS)
