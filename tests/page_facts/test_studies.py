"""The pages of experiments and of the reader of letters have the columns, kinds, tables and totals."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from colony.experiment.conduct import Experiment
from colony.experiment.lists import PUBLISHED_MAP, ListedRun, published_list
from colony.experiment.plates.record import FINDER_NAMES, PLATE_TABLE
from colony.experiment.record import FailureReason
from colony.experiment.results import RUN_TABLE
from colony.experiment.sources.run import NUMBERS
from colony.experiment.studies import PLATES, SOURCES
from colony.nav.confidence.published_plates import PUBLISHED_WALKS
from colony.nav.missions.goal_verification import Verdict
from colony.nav.pose.pose import PoseEstimate
from colony.nav.pose.tracker import Source
from colony.sim.hazards.hazards import Hazards
from colony.vision.letters.network import network
from colony.vision.training.fonts import learned_fonts
from tests.pages import page_text

EXPERIMENTS, LETTERS, PLATES_PAGE, POSE = map(
    page_text, ("experiments.md", "letters.md", "plates.md", "pose.md")
)


@pytest.mark.parametrize(
    ("page", "columns"), [(EXPERIMENTS, RUN_TABLE.columns), (PLATES_PAGE, PLATE_TABLE.columns)]
)
def test_every_column_is_explained(page: str, columns: tuple[str, ...]) -> None:
    explained = {f"{mode}_{what}" for mode in "cd" for what in ("entered", "completed", "needed")}
    assert not set(columns) - explained - set(re.findall(r"`([^`]+)`", page))


def test_every_failure_finder_and_source_is_explained() -> None:
    told = re.findall(r"^\| ([a-z ]+) \| [a-z]", EXPERIMENTS, re.MULTILINE)
    assert set(get_args(FailureReason)) - {""} <= set(told)
    assert all(f"\n| {name} | " in PLATES_PAGE for name in FINDER_NAMES.values())
    assert all(f"\n| {source.value} | " in POSE for source in Source)


@pytest.mark.parametrize(("page", "study"), [(PLATES_PAGE, PLATES), (POSE, SOURCES)])
def test_the_command_at_the_top_is_that_of_the_study(page: str, study: object) -> None:
    [line] = re.findall(r"^    colony experiment (.*)$", page, re.MULTILINE)
    assert line.startswith(f"{study.name} --seeds {study.seeds} ")  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "name", "runs", "variant", "hazards"),
    [
        (PLATES_PAGE, PLATES.name, PLATES.runs(), "ours", Hazards()),
        (POSE, SOURCES.name, SOURCES.runs(), "ours", Hazards()),
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


def test_runs_poses_and_verdicts_are_numbered_as_in_the_code() -> None:
    worth = POSE[POSE.index("## What each source is worth") :]
    assert [int(number) for number in re.findall(r"\((?:run )?(\d+)\)", worth)] == list(NUMBERS)
    rows = re.findall(r"^\| ([\d, ]+) \| ", POSE, re.MULTILINE)
    numbers = [int(number) for row in rows for number in row.split(",")]
    assert numbers == list(range(1, len(PoseEstimate._fields) + 1))
    verdicts = " ".join(POSE[POSE.index("GoalVerified:") :].split(".")[0].split())
    assert {int(number) for number in re.findall(r"-?\d", verdicts)} == set(Verdict)


def test_the_facts_of_the_reader_are_those_of_its_weights() -> None:
    net = network()
    assert f"<!-- facts -->\n```text\n{net.facts}\n```\n<!-- end of facts -->" in LETTERS
    [weights] = re.findall(r"network of ([\d,]+) weights", LETTERS)
    size = sum(layer.kernel.size + layer.bias.size for layer in (*net.layers, *net.head))
    assert int(weights.replace(",", "")) == pytest.approx(size, abs=1000)
    assert f"in {len(learned_fonts())} fonts" in LETTERS
