"""docs/experiments.md: it has every column, failure and option."""

from __future__ import annotations

import re
from typing import get_args

from colony.cli.experiment.main import command
from colony.experiment.record import FailureReason
from colony.experiment.results import RUN_TABLE
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "experiments.md").read_text(encoding="utf-8")
QUOTED = set(re.findall(r"`([^`]+)`", PAGE))


def test_every_column_is_explained() -> None:
    explained = QUOTED | {f"{mode}_{what}" for mode in "cd" for what in ("entered", "completed", "needed")}
    assert not set(RUN_TABLE.columns) - explained


def test_every_failure_is_explained() -> None:
    told = re.findall(r"^\| ([a-z ]+) \| [a-z]", PAGE, re.MULTILINE)
    assert set(get_args(FailureReason)) - {""} <= set(told)


def test_every_option_that_is_shown_exists() -> None:
    options = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    shown = {
        word
        for line in re.findall(r"colony experiment ([^`\n]*)", PAGE)
        for word in line.split()
        if word.startswith("-")
    }
    assert shown
    assert shown <= options


def test_its_pictures_are_there() -> None:
    for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", PAGE):
        assert (ROOT / "docs" / name).is_file()
