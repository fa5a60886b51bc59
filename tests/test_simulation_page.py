"""docs/simulation.md: its commands and its code are run, and its numbers are those of the code."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from colony.cli.run.also import ALSO_FORM, MAX_OTHERS
from colony.cli.shipped_files import MAX_MOVERS
from colony.runtime.observe.summary import OtherSummary, _other_line
from colony.sim.world.movers import WALK_MM_S
from colony.sim.world.people import LONGEST_STOP_S
from tests.cli.conftest import Colony
from tests.cli.conftest import colony as colony
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "simulation.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def test_every_block_is_checked() -> None:
    assert set(BLOCKS) == {"sh", "text", "python"}


@pytest.mark.parametrize("line", BLOCKS["sh"].splitlines())
def test_the_commands_run(line: str, colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    program, *arguments = line.split()
    assert program == "colony"
    result = colony(*arguments, "--duration", "0.2", "--no-picture")
    assert result.code == 0
    for name in re.findall(r"--also (\w+)=", line):
        assert f"\n  {name} (rome with wander) traveled" in result.out


def test_the_line_of_the_summary_is_as_it_is_written() -> None:
    first = OtherSummary(name="rome", robot="rome", behavior="wander", bumps=0, distance_mm=29_300.0)
    unread = ("teleop_turn", "teleop_velocity")
    second = replace(first, name="rome_2", behavior="teleop", distance_mm=0.0, unread=unread)
    assert BLOCKS["text"] == f"{_other_line(first)}\n{_other_line(second)}\n"


def test_the_python_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(BLOCKS["python"], names)
    world = names["world"]
    assert len(world.people) == 5
    assert world.distance(1) > 1_000.0
    assert os.getcwd() == str(ROOT)
    assert capsys.readouterr().out.startswith("Pose(")


def test_the_numbers_are_those_of_the_code() -> None:
    assert f"at most {MAX_MOVERS}" in PAGE
    assert "at {:g} to {:g} m/s".format(*(speed / 1000.0 for speed in WALK_MM_S)) in PAGE
    assert f"for up to {LONGEST_STOP_S:g} s" in PAGE
    assert f"`--also {ALSO_FORM}`" in PAGE
    assert "up to a hundred" in PAGE
    assert MAX_OTHERS == 100
