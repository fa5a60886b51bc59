"""docs/robots.md: its files check, and its commands print what the page shows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from colony.dsl.load import check_file
from tests.body.keys_table import rows
from tests.pages import COMMANDS, is_same_picture, typed
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "robots.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```(?:colony|toml|python) file=(\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))

LISTED = """
  sensor infrared[24] : bool bearing -180 deg from PServer.infrared
  sensor heading : deg                        from RServer.heading
  sensor goal_direction : deg                 from DServer.GoalDirection
  sensor carrying : bool                      from DServer.Carrying
  sensor arm_busy : bool                      from DServer.ArmBusy
  sensor teleop_velocity : mm/s               from DServer.TeleopVelocity
  sensor teleop_turn : deg/s                  from DServer.TeleopTurn
  actuator drive"""
NEAREST = """
let ahead = ranges[0 deg]
let left  = ranges[90 deg]
let right = ranges[-90 deg]
"""
"""What the page lists of the behaviors that come with colony, and `scout` has not."""


@pytest.mark.parametrize("behavior", ["wander", "follow_wall", "teleop", "herbert"])
def test_a_behavior_checks_on_a_robot_that_has_what_is_listed(behavior: str, tmp_path: Path) -> None:
    scout = FILES["robots/scout/scout.colony"].replace("\n  actuator drive", LISTED) + NEAREST
    (tmp_path / "scout.colony").write_text(scout, encoding="utf-8")
    path = ROOT / "behaviors" / f"{behavior}.colony"
    assert check_file(path, robot=str(tmp_path / "scout.colony")).diagnostics == ()
    for name in re.findall(r"sensor (\w+)|let (\w+)", LISTED + NEAREST):
        assert f"`{''.join(name)}`" in PAGE


def test_commands_print_what_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    for commands, shown in COMMANDS.findall(PAGE):
        printed = "".join(typed(command, monkeypatch, errors=True) for command in commands.splitlines())
        assert printed == shown
    assert typed("colony test wander --robot scout", monkeypatch).endswith("7 passed, 0 failed\n")
    typed("colony new walk", monkeypatch)
    assert typed("colony test walk/walk.colony --robot scout", monkeypatch).endswith("1 passed, 0 failed\n")


def test_the_picture_of_omni_is_what_the_command_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "](omni.svg)" in PAGE
    typed("colony robot show omni --picture omni.svg", monkeypatch)
    assert is_same_picture(tmp_path / "omni.svg", ROOT / "docs" / "omni.svg")


def test_the_page_has_every_key_of_a_body() -> None:
    assert "\n".join(rows()) in PAGE
