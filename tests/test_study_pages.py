"""docs/plates.md, pose.md and experiments.md: the command at the top is one, and tables have their place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from colony.cli.experiment.main import command
from colony.experiment.conduct import Experiment
from colony.experiment.lists import PUBLISHED_MAP, ListedRun, published_list
from colony.experiment.studies import PLATES, SOURCES
from colony.sim.hazards.hazards import Hazards

DOCS = Path(__file__).parent.parent / "docs"
OPTIONS = {name for parameter in command.params for name in parameter.opts}


@pytest.mark.parametrize(
    ("page", "name", "seeds"),
    [("plates.md", PLATES.name, PLATES.seeds), ("pose.md", SOURCES.name, SOURCES.seeds)],
)
def test_the_command_at_the_top_is_one(page: str, name: str, seeds: int) -> None:
    [line] = re.findall(r"^    colony experiment (.*)$", (DOCS / page).read_text(), re.MULTILINE)
    assert line.split()[0] == name
    assert {word for word in line.split() if word.startswith("-")} <= OPTIONS
    assert f"--seeds {seeds}" in line


@pytest.mark.parametrize(
    ("page", "name", "runs", "variant", "hazards"),
    [
        ("plates.md", PLATES.name, PLATES.runs(), "ours", Hazards()),
        ("pose.md", SOURCES.name, SOURCES.runs(), "ours", Hazards()),
        ("experiments.md", "thesis", published_list(), "thesis", Hazards()),
        ("experiments.md", "thesis", published_list(), "ours", Hazards()),
        ("experiments.md", "thesis", published_list(), "thesis", Hazards.none()),
    ],
)
def test_there_is_a_place_for_the_tables(
    page: str, name: str, runs: tuple[ListedRun, ...], variant: str, hazards: Hazards
) -> None:
    text = (DOCS / page).read_text()
    of = Experiment(
        name=name, map_path=PUBLISHED_MAP, runs=runs, seeds=(1,), variant=variant, hazards=hazards
    )
    begin, end = (f"<!-- {part}{name} {of.label} -->" for part in ("", "end of "))
    assert text.count(begin) == text.count(end) == 1
    assert text.index(begin) < text.index(end)
