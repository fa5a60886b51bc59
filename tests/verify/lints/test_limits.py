"""Lints of limits: bounds that contradict each other, and bounds that turn a stop into motion."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import load_text
from colony.ir.frame import FrameEvent
from colony.text.diagnostics import Diagnostic
from colony.verify.lints import lint
from colony.verify.lints.proof import replay
from tests.verify.lints.programs import ROBOT, USES, codes, found
from tests.verify.small_robot import go

GO = go("a", "true") + "network { drive = a }\n"
LIFT = """robot r {
  sensor   level : number range 0 .. 100 default 0 from DServer.Level
  sensor   wish  : mm range 0 .. 1000 from DServer.Wish
  actuator lift { height : m range 0 .. 2 } to DServer.Lift idle IDLE
}
module reach { when true do lift(height = wish) }
network { lift = reach }
contract uses: level >= 0 or level < 0
"""


def of_lift(limits: str, idle: str = "hold") -> list[Diagnostic]:
    """What is said of a program that raises a lift."""
    return [f.diagnostic for f in lint(load_text(LIFT.replace("IDLE", idle) + limits))]


def test_limits_that_contradict_each_other_give_a_run() -> None:
    text = GO + "limit drive.velocity <= 50 mm/s when bumper\nlimit drive.velocity >= level * 1 mm/s\n"
    program = load_text(ROBOT + text + USES)
    [contradict, _] = lint(program)
    assert contradict.diagnostic.code == "V033"
    assert contradict.diagnostic.severity == "warning"
    assert [label.text for label in contradict.diagnostic.labels] == ["the other limit"]
    trace = contradict.run.trace
    outcome = replay(program, trace.snapshots)[-1]
    assert outcome == trace.outcomes[-1]
    assert outcome.records == (FrameEvent("limits contradict", "drive.velocity"),)
    assert trace.snapshots[-1].readings.get("bumper", True) is True
    assert trace.snapshots[-1].readings["level"] > 50  # type: ignore[operator]


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ("limit drive.velocity <= 50 mm/s\nlimit drive.velocity >= -50 mm/s\n", []),
        ("limit drive.velocity <= 0\nlimit drive.velocity >= 0\n", []),
        ("limit drive.turn >= 10 deg/s\nlimit drive.velocity <= -10 mm/s\n", ["V034", "V034"]),
        ("limit drive.velocity <= -50 mm/s\nlimit drive.velocity >= 50 mm/s\n", ["V033"]),
        ("limit drive.velocity <= -50 mm/s when bumper\nlimit drive.velocity >= 50 mm/s when not bumper\n",
         ["V033", "V034"]),  # both apply where `bumper` is missing
        ("limit drive.velocity <= 0 when bumper\nlimit drive.velocity >= 0 when not bumper\n", []),
        ("limit drive.velocity >= 601 mm/s when level > 50\n", ["V033"]),  # above the range
        ("limit drive.velocity >= 600 mm/s when level > 50\n", ["V034"]),
        ("limit drive.velocity >= 600 mm/s when level > 100\n", []),  # never applies
        ("limit drive.velocity >= level * 7 mm/s\n", ["V033", "V034"]),
        ("limit drive.velocity <= sonar / 1 s\n", []),  # missing, it stands at 0
        ("limit drive.velocity <= (sonar - 1 mm) / 1 s\n", ["V034"]),
        ("limit drive.velocity <= max(sonar - 1 mm, 0) / 1 s\n", []),
        ("limit drive.velocity >= 1 / (level - 50) * 1 mm/s when level <= 50\n", []),  # infinite, it is 0
    ],
)  # fmt: skip
def test_which_limits_are_found(limits: str, expected: list[str]) -> None:
    assert codes(GO + limits) == expected


def test_what_is_said_of_a_stop_that_becomes_motion() -> None:
    [(code, message)] = found(GO + "limit drive.velocity >= 100 mm/s when level > 50\n")
    assert code == "V034"
    assert message == (
        "`drive.velocity` is at least 100 mm/s at 0 s of a run of 1 frame: a module that commands 0 mm/s, "
        "as the idle command does, gets 100 mm/s instead"
    )


def test_a_limit_that_memory_tightens() -> None:
    slow = GO + "limit drive.velocity >= 100 mm/s when recently(level > 50, 1 s) and level < 50\n"
    program = load_text(ROBOT + slow + USES)
    [finding] = lint(program)
    assert finding.diagnostic.code == "V034"
    assert len(finding.run.trace.snapshots) == 2
    assert codes(slow.replace("and level < 50", "and level < 0")) == []


def test_nothing_is_limited_where_no_module_wins() -> None:
    text = go("a", "level < 50") + "network { drive = a }\n"
    assert codes(text + "limit drive.velocity >= 100 mm/s when level > 60\n") == []
    assert codes(text + "limit drive.velocity >= 100 mm/s when level > 40\n") == ["V034"]
    blind = "failsafe " + go("a", "sonar > 0") + "network { drive = a }\n"
    assert "V034" not in codes(blind + "limit drive.velocity >= 100 mm/s when not fresh(sonar)\n")
    assert "V034" in codes(blind + "limit drive.velocity >= 100 mm/s when fresh(sonar)\n")


def test_a_limit_that_contradicts_one_of_an_imported_robot(tmp_path: Path) -> None:
    (tmp_path / "robot.colony").write_text(ROBOT + "limit drive.velocity <= sonar / 2 s\n")
    text = 'import "robot.colony"\n' + GO
    assert lint(load_text(text, directory=tmp_path)) == ()
    text += "limit drive.velocity >= 200 mm/s when bumper\n"
    contradict, excluded = lint(load_text(text, directory=tmp_path))
    assert contradict.diagnostic.code == "V033"
    [other] = contradict.diagnostic.labels
    assert other.span.source.name.endswith("robot.colony")
    assert excluded.diagnostic.code == "V034"


def test_a_command_that_is_not_finite_does_not_hide_a_contradiction() -> None:
    text = go("a", "true", "100 mm/s / level") + "network { drive = a }\nlimit drive.velocity >= 50 mm/s\n"
    assert "V033" in codes(text + "limit drive.velocity <= -50 mm/s when level < 50\n")
    assert "V033" not in codes(text + "limit drive.velocity <= -50 mm/s when level < 0 or level > 100\n")


def test_a_contradiction_is_an_error_where_nothing_is_sent_then() -> None:
    [found] = of_lift("limit lift.height <= 1 m when level > 50\nlimit lift.height >= 1.5 m\n")
    assert (found.code, found.severity) == ("V033", "error")
    assert found.message == (
        "the limits of `lift.height` contradict each other at 0 s of a run of 1 frame: at least 1.5 m, "
        "at most 1 m; nothing is sent"
    )
    [found] = of_lift(
        "limit lift.height >= 1.5 m\nlimit lift.height <= 1 m when level > 50\n", "lift(height = 1.5 m)"
    )
    assert (found.code, found.severity) == ("V033", "warning")


def test_a_missing_bound_on_hold_is_no_contradiction() -> None:
    assert of_lift("limit lift.height <= 1 m\nlimit lift.height >= min(wish, 1 m)\n") == []
    [found] = of_lift("limit lift.height <= 999 mm\nlimit lift.height >= min(wish, 1 m)\n")
    assert found.code == "V033"


def test_an_idle_height_that_is_not_zero() -> None:
    limit = "limit lift.height <= 0.9 m when level > 50\n"
    [found] = of_lift(limit, "lift(height = 1 m)")
    assert (found.code, "at most 0.9 m" in found.message) == ("V034", True)
    assert of_lift(limit.replace("0.9", "1"), "lift(height = 1 m)") == []
    assert of_lift("limit lift.height <= wish when level > 50\n", "lift(height = 0)") == []


def test_limits_of_an_actuator_that_nothing_drives_are_not_looked_at() -> None:
    robot = ROBOT.replace("}\n\n", "}\n").replace(
        "\n}\n", "\n  actuator lamp { level : number } to DServer.Lamp idle hold\n}\n"
    )
    assert "actuator lamp" in robot
    assert found(GO + "limit lamp.level <= 0\nlimit lamp.level >= 1\n", robot) == []


def test_a_run_needs_no_module_in_python() -> None:
    text = 'module p from python "nowhere:Nothing" { reads sonar commands drive }\n' + go("a", "true")
    text += "network { drive = p suppresses a }\nlimit drive.velocity >= 1 mm/s\n"
    assert codes(text) == ["V034"]


def test_two_fields_of_one_actuator_that_contradict() -> None:
    limits = "limit drive.velocity <= 5 mm/s\nlimit drive.velocity >= level * 1 mm/s\n"
    limits += "limit drive.turn <= 5 deg/s\nlimit drive.turn >= level * 1 deg/s\n"
    assert codes(GO + limits).count("V033") == 2


def test_a_contradiction_of_products() -> None:
    assert [d.code for d in of_lift("limit lift.height >= wish * level\n")] == ["V033"]


def test_a_contradiction_in_a_late_phase() -> None:
    phases = "a -> b when level > 1  b -> c when level > 2  c -> d when level > 3  d -> e when level > 4"
    machine = f"machine m {{ start a  {phases} }}\n"
    limits = "limit lift.height <= 1 m when m == m.e\nlimit lift.height >= 1.5 m when level > 50\n"
    assert [(d.code, d.severity) for d in of_lift(machine + limits)] == [("V033", "error")]


def test_limits_that_are_undecided() -> None:
    count = "state n : number = 0\nnext n = if rising(level > 50) then n + 1 else n\n"
    [undecided] = of_lift(count + "limit lift.height <= (1000 - n) * 1 m\n")
    assert (undecided.code, undecided.severity) == ("V035", "note")
    assert undecided.message.startswith(
        "whether limits of `lift.height` can contradict each other is unknown: "
    )
