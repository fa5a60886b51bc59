"""docs/missions.md: its commands print what it says, and its numbers are those of the program."""

from __future__ import annotations

import pytest

from colony.nav.maps.building import load_building
from colony.nav.missions.elevator_calls import ElevatorCall
from colony.nav.missions.elevator_prompt import instructions
from colony.sim.world.operator import DELAY_S, RIDE_S, STANDSTILL_S
from tests.pages import COMMANDS, typed
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "missions.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("commands", "printed"), COMMANDS.findall(PAGE))
def test_commands_print_what_the_page_says(
    commands: str, printed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    assert "".join(typed(line, monkeypatch) for line in commands.splitlines()) == printed


def test_the_operator_is_as_slow_as_the_page_says() -> None:
    assert f"{DELAY_S[0]:g} to {DELAY_S[1]:g} s |" in PAGE
    assert f"{RIDE_S[0]:g} to {RIDE_S[1]:g} s |" in PAGE
    assert PAGE.count(f"for {STANDSTILL_S:g} s") == 2


def test_the_question_at_the_terminal_is_the_one_on_the_page() -> None:
    building = load_building(ROOT / "maps" / "msu_engineering_3.stickrep")
    assert (
        instructions(building, ElevatorCall("acs.elev.L", "msu_engineering_3", "msu_engineering_2")) in PAGE
    )
