"""docs/pose.md: its options, sources and numbers are those that there are."""

from __future__ import annotations

import re

from colony.cli.experiment.main import command
from colony.experiment.sources.run import NUMBERS
from colony.nav.missions.goal_verification import Verdict
from colony.nav.pose.pose import PoseEstimate
from colony.nav.pose.tracker import Source
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "pose.md").read_text(encoding="utf-8")


def test_the_options_are_those_that_there_are() -> None:
    options = {name for parameter in command.params for name in parameter.opts}
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
