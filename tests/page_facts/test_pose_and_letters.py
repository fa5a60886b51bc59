"""The pages of the pose and of the reader of letters have the sources, numbers and facts of the code."""

from __future__ import annotations

import re

import pytest

from colony.nav.missions.goal_verification import GoalVerdict
from colony.nav.pose.pose import PoseEstimate
from colony.nav.pose.tracker import PoseSource
from colony.vision.letters.decoding import network
from tests.pages import page_text
from tools.training.fonts import learned_fonts

LETTERS, POSE = map(page_text, ("letters.md", "pose.md"))


def test_every_source_of_the_pose_is_explained() -> None:
    assert all(f"\n| {source.value} | " in POSE for source in PoseSource)


def test_poses_and_verdicts_are_numbered_as_in_the_code() -> None:
    rows = re.findall(r"^\| ([\d, ]+) \| ", POSE, re.MULTILINE)
    numbers = [int(number) for row in rows for number in row.split(",")]
    assert numbers == list(range(1, len(PoseEstimate._fields) + 1))
    verdicts = " ".join(POSE[POSE.index("GoalVerified:") :].split(".")[0].split())
    assert {int(number) for number in re.findall(r"-?\d", verdicts)} == set(GoalVerdict)


def test_the_facts_of_the_reader_are_those_of_its_weights() -> None:
    net = network()
    assert f"<!-- facts -->\n```text\n{net.facts}\n```\n<!-- end of facts -->" in LETTERS
    [weights] = re.findall(r"network of ([\d,]+) weights", LETTERS)
    size = sum(layer.kernel.size + layer.bias.size for layer in (*net.layers, *net.head))
    assert int(weights.replace(",", "")) == pytest.approx(size, abs=1000)
    assert f"in {len(learned_fonts())} fonts" in LETTERS
