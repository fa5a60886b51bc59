"""A closed loop of robot and world: proved with the limits of RoME, refuted with worse ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import load_file
from colony.ir.program import Program
from colony.verify.contracts.concrete_runs import Replay
from colony.verify.contracts.prove import prove_contracts, results
from colony.verify.contracts.results import Proved, Refuted
from tests.examples.stage import ROOT

LOOP = (ROOT / "examples" / "closed_loop.colony").read_text()
ROME = ROOT / "robots" / "rome"

AHEAD, BEHIND = "room_to_stop", "room_to_stop_behind"

MARGIN = ("param margin = 150 mm", "param margin = {}")
REACTION = ("param reaction = 1 s", "param reaction = {}")
FASTEST_AHEAD = "shared.fastest(ranges[-60 deg .. 60 deg], margin, reaction)"
FASTEST_BEHIND = "shared.fastest(ranges[120 deg .. -120 deg], margin, reaction)"


def with_value(line: tuple[str, str], value: str) -> tuple[str, str]:
    return line[0], line[1].format(value)


BUGS = {
    "a margin of two thirds": (*with_value(MARGIN, "100 mm"), AHEAD),
    "a margin that is the hull": (*with_value(MARGIN, "40 mm"), AHEAD),
    "no margin": (*with_value(MARGIN, "0 mm"), BEHIND),
    "a slow reaction": (*with_value(REACTION, "0.7 s"), AHEAD),
    "a reaction in half the time": (*with_value(REACTION, "0.5 s"), BEHIND),
    "a cone ahead that is too narrow": (FASTEST_AHEAD, FASTEST_AHEAD.replace("60", "45"), AHEAD),
    "a beam ahead": (FASTEST_AHEAD, FASTEST_AHEAD.replace("60", "7"), AHEAD),
    "a cone to the left alone": (FASTEST_AHEAD, FASTEST_AHEAD.replace("-60", "0"), AHEAD),
    "a cone behind that is too narrow": (FASTEST_BEHIND, FASTEST_BEHIND.replace("120", "135"), BEHIND),
    "a limit behind that looks ahead": (FASTEST_BEHIND, FASTEST_AHEAD, BEHIND),
    "a limit ahead that looks behind": (FASTEST_AHEAD, FASTEST_BEHIND, AHEAD),
    "no margin behind": (FASTEST_BEHIND, FASTEST_BEHIND.replace("margin", "0 mm"), BEHIND),
    "a short reaction behind": (FASTEST_BEHIND, FASTEST_BEHIND.replace("reaction", "0.6 s"), BEHIND),
    "a mean in place of the least": (
        FASTEST_AHEAD,
        "max(0 mm, mean(ranges[-60 deg .. 60 deg]) - margin) / reaction",
        AHEAD,
    ),
    "infrared replaces sonar": ("min(fastest_heard, 250 mm/s)", "250 mm/s", AHEAD),
    "it creeps whatever is near": ("else fastest_heard", "else max(fastest_heard, 50 mm/s)", AHEAD),
    "a bound that is never renewed": (FASTEST_BEHIND, f"captured({FASTEST_BEHIND}, now > 1 s)", BEHIND),
    "a base that brakes slowly": ("param braking = 800 mm/s^2", "param braking = 300 mm/s^2", AHEAD),
    "who runs toward it": ("param walking = 200 mm/s", "param walking = 800 mm/s", AHEAD),
    "sonars with five times the noise": ("param noise   = 15 mm", "param noise   = 75 mm", BEHIND),
}
"""What is replaced in the text of the robot or of the loop, by what, and the contract that then breaks."""

OPEN_LOOP = (
    "slow_unheard",
    "brakes_in_time",
    "never_rams",
    "never_backs_into",
    "stands_blind",
    "stands_numb",
)


def loop_with(folder: Path, old: str, new: str) -> Program:
    """Return the closed loop with a text of it or of its robot replaced."""
    robot = (ROME / "rome.colony").read_text()
    assert (robot + LOOP).count(old) == 1
    (folder / "rome.toml").write_bytes((ROME / "rome.toml").read_bytes())
    (folder / "rome.colony").write_text(robot.replace(old, new))
    (folder / "loop.colony").write_text(LOOP.replace(old, new))
    return load_file(folder / "loop.colony")


@pytest.mark.long
def test_the_contracts_of_the_loop_are_proved_in_floats_operators_included() -> None:
    program = load_file(ROOT / "examples" / "closed_loop.colony")
    for result in prove_contracts(program):
        assert isinstance(result, Proved)
        assert not result.over_reals
        assert result.operators or result.contract.name.startswith("wander.")


@pytest.mark.long
@pytest.mark.parametrize("bug", BUGS)
def test_a_bug_that_the_limits_do_not_show_breaks_the_loop(bug: str, tmp_path: Path) -> None:
    old, new, contract = BUGS[bug]
    program = loop_with(tmp_path, old, new)
    assert all(isinstance(r, Proved) for r in results(program, list(OPEN_LOOP)))
    [found] = results(program, [contract])
    assert isinstance(found, Refuted)
    assert Replay(program, contract).breaks(found.trace.snapshots)
