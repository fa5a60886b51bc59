"""docs/plates.md: it has every column, every finder, a place for its tables, and the published totals."""

from __future__ import annotations

import re
from pathlib import Path

from colony.cli.experiment.main import command
from colony.experiment.conduct import Experiment
from colony.experiment.lists import PUBLISHED_MAP, plate_list
from colony.experiment.plates.record import FINDER_NAMES, PLATE_TABLE
from colony.experiment.studies import PLATES
from colony.nav.confidence.published_plates import PUBLISHED_WALKS
from colony.sim.hazards.hazards import Hazards

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "plates.md").read_text(encoding="utf-8")


def test_every_column_is_explained() -> None:
    assert not set(PLATE_TABLE.columns) - set(re.findall(r"`([^`]+)`", PAGE))


def test_every_finder_is_explained() -> None:
    for name in FINDER_NAMES.values():
        assert f"\n| {name} | " in PAGE


def test_the_command_at_the_top_is_one() -> None:
    [line] = re.findall(r"^    colony experiment (.*)$", PAGE, re.MULTILINE)
    options = {name for parameter in command.params for name in parameter.opts}
    assert line.split()[0] == PLATES.name
    assert {word for word in line.split() if word.startswith("-")} <= options
    assert f"--seeds {PLATES.seeds}" in line


def test_there_is_a_place_for_the_tables() -> None:
    ours = Experiment(
        name=PLATES.name, map_path=PUBLISHED_MAP, runs=plate_list(), seeds=(1,), variant="ours",
        hazards=Hazards(),
    )  # fmt: skip
    begin, end = (f"<!-- {of}{ours.name} {ours.label} -->" for of in ("", "end of "))
    assert PAGE.count(begin) == PAGE.count(end) == 1
    assert PAGE.index(begin) < PAGE.index(end)


def test_the_published_totals_are_those_of_the_table() -> None:
    found, missed, false = (
        sum(len(part) for part in parts)
        for parts in zip(*((w.found, w.missed, w.false) for w in PUBLISHED_WALKS), strict=True)
    )
    assert f"{found} detected plates, {missed} missed and {false} false ones" in PAGE


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert (ROOT / "docs" / target).exists(), target
