"""Lints that say "can": each rests on a run of the reference interpreter."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import load_file, load_text
from colony.verify.lints import lint
from tests.paths import BEHAVIORS, ROOT
from tests.sampling import sampled
from tests.verify.lints.programs import ROBOT, USES, codes, found, linted
from tests.verify.small_robot import go

BLIND = "module blind { when not (fresh(sonar) and fresh(bumper)) }\n"


# --- commands and ranges ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("velocity", "turn", "expected"),
    [
        ("600 mm/s", "0", []),
        ("601 mm/s", "0", ["V025"]),
        ("0", "level * 1 deg/s", ["V025"]),
        ("0", "level * 0.9 deg/s", []),
        ("0", "clamp(level * 1 deg/s, -90 deg/s, 90 deg/s)", []),
        ("level * 7 mm/s", "level * 1 deg/s", ["V025", "V025"]),
    ],
)
def test_a_command_beyond_the_range(velocity: str, turn: str, expected: list[str]) -> None:
    assert codes(go("a", "true", velocity, turn) + "network { drive = a }") == expected


def test_what_is_said_of_a_command_beyond_the_range() -> None:
    text = go("a", "true", turn="if bumper then 100 deg/s else 0 deg/s") + "network { drive = a }"
    message = "`a` can command drive.turn = 100 deg/s, which is clamped: its range is -90 deg/s .. 90 deg/s"
    assert found(text) == [("V025", message)]


def test_what_a_limit_always_brings_back_is_in_range() -> None:
    text = go("a", "true", "level * 7 mm/s") + "network { drive = a }\n"
    assert codes(text) == ["V025"]
    assert codes(text + "limit drive.velocity <= 500 mm/s\n") == []


def test_a_module_that_never_wins_beyond_the_range() -> None:
    text = go("a", "level > 80", "level * 7 mm/s") + "module i { when level > 85 }\n"
    assert codes(text + "network { drive = i inhibits a }") == []


def test_a_run_beyond_the_range_needs_no_module_in_python() -> None:
    text = 'module p from python "nowhere:Nothing" { reads sonar commands drive }\n'
    text += go("a", "true", "level * 7 mm/s") + "network { drive = p suppresses a }\n"
    assert codes(text) == ["V025"]


def test_command_beyond_range_after_an_answer_in_python_is_found() -> None:
    text = 'module p from python "nowhere:Nothing" { reads sonar }\n'
    text += go("a", "true", "level * 7 mm/s") + go("b", "true")
    assert "V025" in codes(text + "network { drive = (p inhibits b) suppresses a }\n")


# --- missing sensors -------------------------------------------------------------------------------

AVOID = go("cruise", "true") + go("avoid", "sonar < 1 m", "80 mm/s", "30 deg/s")


def test_a_robot_that_drives_on_without_a_sensor() -> None:
    assert found(AVOID + "network { drive = avoid suppresses cruise }") == [
        ("V030", "with `sonar` missing, `cruise` can drive: `avoid`, which reads it, is silent then")
    ]


def test_it_is_safe_where_something_inhibits_without_the_sensor() -> None:
    text = AVOID + "module blind { when not fresh(sonar) }\n"
    assert codes(text + "network { drive = blind inhibits (avoid suppresses cruise) }") == []
    assert codes(text + "network { drive = avoid suppresses (blind inhibits cruise) }") == []


def test_a_module_that_is_no_slower_is_no_safeguard() -> None:
    text = AVOID.replace("80 mm/s", "300 mm/s")
    assert codes(text + "network { drive = avoid suppresses cruise }") == []


def test_backing_off_and_standing_still_are_safeguards() -> None:
    for velocity in ("-100 mm/s", "0"):
        text = go("cruise", "true") + go("back", "bumper", velocity)
        assert found(text + "network { drive = back suppresses cruise }") == [
            ("V030", "with `bumper` missing, `cruise` can drive: `back`, which reads it, is silent then")
        ]


def test_a_guard_of_an_actuator_with_fields_that_have_no_order() -> None:
    robot = ROBOT.replace("turn : deg/s range -90 .. 90", "on : bool").replace("turn = 0", "on = false")
    text = "module cruise { when true do drive(velocity = 300 mm/s, on = true) }\n"
    text += "module halt { when bumper do drive(velocity = 300 mm/s, on = false) }\n"
    wired = "network { drive = halt suppresses cruise }"
    message = "with `bumper` missing, `cruise` can drive: `halt`, which reads it, is silent then"
    assert found(text + wired, robot) == [("V030", message)]
    assert found(text.replace("on = false", "on = true") + wired, robot) == []


def test_a_sensor_with_a_default_is_never_missing() -> None:
    text = go("cruise", "true") + go("halt", "level > 50", "0")
    assert codes(text + "network { drive = halt suppresses cruise }") == []


def test_an_inhibitor_that_reads_the_sensor_is_a_safeguard() -> None:
    text = go("cruise", "true") + "module near { when sonar < 1 m }\n"
    assert codes(text + "network { drive = near inhibits cruise }") == ["V030"]
    both = go("cruise", "sonar > 0") + "module near { when sonar < 1 m }\n"
    assert codes(both + "network { drive = near inhibits cruise }") == []


def test_all_modules_that_guard_against_the_same_are_named_together() -> None:
    text = AVOID + go("halt", "sonar < 500 mm", "0")
    [(_, message)] = found(text + "network { drive = halt suppresses avoid suppresses cruise }")
    assert message == (
        "with `sonar` missing, `cruise` can drive: `avoid` and `halt`, which read it, are silent then"
    )


# --- time constants that hold too little -----------------------------------------------------------

THREE = go("a", "level > 90") + go("b", "level > 50") + go("c", "true")


def test_the_pause_of_an_inner_node_lets_lesser_behaviors_through() -> None:
    [(code, message)] = found(THREE + "network { drive = (a suppresses[1 s] b) suppresses c }")
    assert code == "V031"
    assert message == "within 1 s after `a`, `b` is held back, and `c`, which it dominates, gets through"


def test_a_pause_that_holds_all_is_good() -> None:
    assert codes(THREE + "network { drive = a suppresses[1 s] (b suppresses c) }") == []
    assert codes(THREE + "network { drive = (a suppresses b) suppresses c }") == []


# --- sensors ---------------------------------------------------------------------------------------


def test_sensors_that_nothing_reads() -> None:
    text = ROBOT + go("a", "bumper") + "network { drive = a }"
    assert [(d.code, d.message) for d in linted(text)] == [
        ("V028", "nothing reads the sensor `sonar`"),
        ("V028", "nothing reads the sensor `level`"),
    ]


def test_sensors_of_a_robot_that_is_imported_are_for_others_too(tmp_path: Path) -> None:
    (tmp_path / "robot.colony").write_text(ROBOT)
    text = 'import "robot.colony"\n' + go("a", "bumper") + "network { drive = a }"
    assert lint(load_text(text, directory=tmp_path)) == ()


def test_a_file_without_a_network_has_no_lints() -> None:
    assert lint(load_text(ROBOT + go("a", "sonar > 11 m") + USES)) == ()


# --- what ships ------------------------------------------------------------------------------------

WARNED = ROOT / "examples" / "sensor_loss" / "ordinary.colony"
"""Shows what V030 is about; docs/when-a-sensor-dies.md prints the warnings."""

SHIPPED = sorted({*BEHAVIORS, *(ROOT / "examples").rglob("*.colony")} - {WARNED})


@pytest.mark.parametrize("path", sampled(SHIPPED, every=len(SHIPPED), thorough=True), ids=lambda p: p.stem)
def test_nothing_is_said_of_what_ships(path: Path) -> None:
    assert lint(load_file(path)) == ()


def test_a_module_in_python_may_answer_anything() -> None:
    text = """
module p from python "nowhere:Nothing" { reads level commands drive }
network { drive = p suppresses a }
"""
    assert codes(go("a", "level > 50") + text) == []
    assert codes(go("a", "level > 100") + text) == ["V021"]


def test_a_guard_that_commands_another_actuator_restrains_by_inhibiting_only() -> None:
    robot = """robot r {
  sensor level : number range 0 .. 10 from P.level
  sensor sure : bool default false from P.sure
  actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)
  actuator lamp { on : bool } to DServer.Lamp idle lamp(on = false)
}
module signal { when level > 5 do lamp(on = true) }
module go { when sure do drive(velocity = 100 mm/s) }
"""
    warned = linted(robot + "network { lamp = signal  drive = signal inhibits go }")
    assert [w.code for w in warned] == ["V030"]
    assert lint(load_text(robot + "network { lamp = signal  drive = go }")) == ()
