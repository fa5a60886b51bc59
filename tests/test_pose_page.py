"""docs/pose.md: its commands, sources and numbers are those that there are; it has a place for its table."""

from __future__ import annotations

import re
from pathlib import Path

from colony.cli.experiment.main import command
from colony.experiment.conduct import Experiment
from colony.experiment.lists import PUBLISHED_MAP
from colony.experiment.sources.run import NUMBERS, source_list
from colony.experiment.studies import SOURCES
from colony.nav.missions.goal_verification import Verdict
from colony.nav.pose.pose import PoseEstimate
from colony.nav.pose.tracker import Source
from colony.sim.hazards.hazards import Hazards

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "pose.md").read_text(encoding="utf-8")


def test_the_command_at_the_top_is_one() -> None:
    [line] = re.findall(r"^    colony experiment (.*)$", PAGE, re.MULTILINE)
    options = {name for parameter in command.params for name in parameter.opts}
    assert line.split()[0] == SOURCES.name
    assert {word for word in line.split() if word.startswith("-")} <= options
    assert f"--seeds {SOURCES.seeds}" in line
    assert {"--no-source", "--side-camera"} <= options


def test_every_source_is_explained() -> None:
    for source in Source:
        assert f"\n| {source.value} | " in PAGE


def test_the_runs_are_named() -> None:
    text = PAGE[PAGE.index("## What each source is worth") :]
    assert [int(number) for number in re.findall(r"\((?:run )?(\d+)\)", text)] == list(NUMBERS)


def test_the_list_of_a_pose_has_as_many_numbers_as_a_pose() -> None:
    rows = re.findall(r"^\| ([\d, ]+) \| ", PAGE, re.MULTILINE)
    numbers = [int(number) for row in rows for number in row.split(",")]
    assert numbers == list(range(1, len(PoseEstimate._fields) + 1))


def test_the_verdicts_are_those_that_there_are() -> None:
    text = " ".join(PAGE[PAGE.index("GoalVerified:") :].split(".")[0].split())
    assert {int(number) for number in re.findall(r"-?\d", text)} == set(Verdict)


def test_there_is_a_place_for_the_table() -> None:
    ours = Experiment(
        name=SOURCES.name, map_path=PUBLISHED_MAP, runs=source_list(), seeds=(1,), variant="ours",
        hazards=Hazards(),
    )  # fmt: skip
    begin, end = (f"<!-- {of}{ours.name} {ours.label} -->" for of in ("", "end of "))
    assert PAGE.count(begin) == PAGE.count(end) == 1
    assert PAGE.index(begin) < PAGE.index(end)
