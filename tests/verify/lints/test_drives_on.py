"""Robots that drive on without a sensor, because of failsafe modules or of memory that stays as it is."""

from __future__ import annotations

import pytest

from tests.verify.lints.programs import ROBOT, USES, codes, found, linted
from tests.verify.small_robot import go, robot

AVOID = go("cruise", "true") + go("avoid", "sonar < 1 m", "80 mm/s", "30 deg/s")
AVOIDING = "network { drive = avoid suppresses cruise }\n"


def messages(text: str) -> list[str]:
    """The messages of the warnings V030."""
    return [message for code, message in found(text) if code == "V030"]


def hints(text: str) -> list[str | None]:
    """The hints of the warnings V030."""
    return [d.hint for d in linted(ROBOT + text + USES) if d.code == "V030"]


# --- failsafe safeguards ---------------------------------------------------------------------------


def test_a_failsafe_safeguard_is_the_cure_and_is_no_finding() -> None:
    assert hints(AVOID + AVOIDING) == [
        "write `failsafe module avoid`, or wire a module `when not fresh(sonar)` that inhibits `cruise`"
    ]
    assert hints((AVOID + AVOIDING).replace("module avoid", "failsafe module avoid")) == []


def test_what_takes_speeds_moves_whatever_its_server() -> None:
    text = ROBOT.replace("to RServer.drive", "to Base.drive") + AVOID + AVOIDING + USES
    assert "V030" in {d.code for d in linted(text)}


def test_a_failsafe_safeguard_that_inhibits() -> None:
    text = (
        go("cruise", "true") + "module near { when sonar < 1 m }\nnetwork { drive = near inhibits cruise }\n"
    )
    assert len(hints(text)) == 1
    assert hints(text.replace("module near", "failsafe module near")) == []


def test_of_two_safeguards_both_are_to_be_failsafe() -> None:
    text = AVOID + go("halt", "sonar < 500 mm", "0")
    [hint] = hints(text + "network { drive = halt suppresses avoid suppresses cruise }\n")
    assert hint.startswith("write `failsafe module avoid` and `failsafe module halt`, or wire ")


def test_one_failsafe_safeguard_is_enough_for_one_sensor() -> None:
    text = AVOID + go("halt", "sonar < 500 mm", "0").replace("module", "failsafe module")
    assert hints(text + "network { drive = halt suppresses avoid suppresses cruise }\n") == []


def test_a_failsafe_module_that_guards_a_sensor_leaves_the_others() -> None:
    text = AVOID.replace("module avoid", "failsafe module avoid") + go("back", "bumper", "-50 mm/s")
    told = messages(text + "network { drive = back suppresses avoid suppresses cruise }\n")
    assert [m.partition(": ")[0] for m in told] == [
        "with `bumper` missing, `cruise` can drive",
        "with `bumper` missing, `avoid` can drive",
    ]


# --- failsafe modules that hold a safeguard back ---------------------------------------------------

CARRY = AVOID.replace("module avoid", "failsafe module avoid") + "failsafe module carry { when bumper }\n"


def test_a_failsafe_module_that_holds_a_safeguard_back() -> None:
    text = CARRY + "network { drive = (carry inhibits avoid) suppresses cruise }\n"
    message = (
        "with `bumper` missing, `cruise` can drive: `carry`, which is failsafe, is active then and holds "
        "back `avoid`"
    )
    assert ("V030", message) in found(text)
    assert hints(text) == ["wire `carry` so that it inhibits `cruise` too"]


@pytest.mark.parametrize(
    ("wiring", "expected"),
    [
        ("(carry inhibits avoid) suppresses cruise", 1),
        ("carry inhibits (avoid suppresses cruise)", 0),
        ("(carry inhibits avoid) suppresses (carry inhibits cruise)", 0),
        ("(spare inhibits avoid) suppresses cruise", 0),  # reads nothing that can be missing
    ],
)
def test_where_a_failsafe_module_holds_a_safeguard_back(wiring: str, expected: int) -> None:
    text = CARRY + "failsafe module spare { when level > 50 }\n"
    assert len(hints(text + f"network {{ drive = {wiring} }}\n")) == expected


def test_an_ordinary_module_that_inhibits_a_safeguard_is_silent_without_its_sensor() -> None:
    text = CARRY.replace("failsafe module carry", "module carry")
    told = messages(text + "network { drive = (carry inhibits avoid) suppresses cruise }\n")
    assert [m.partition(":")[0] for m in told] == ["with `bumper` missing, `avoid` can drive"]


def test_what_is_held_back_has_to_be_a_safeguard() -> None:
    text = CARRY.replace("80 mm/s", "400 mm/s")
    assert hints(text + "network { drive = (carry inhibits avoid) suppresses cruise }\n") == []


def test_a_module_that_needs_the_sensor_itself_does_not_drive() -> None:
    text = CARRY.replace("cruise { when true", "cruise { when value_or(bumper, false) or true")
    assert hints(text + "network { drive = (carry inhibits avoid) suppresses cruise }\n") != []
    text = CARRY.replace("cruise { when true", "cruise { when bumper or true")
    assert hints(text + "network { drive = (carry inhibits avoid) suppresses cruise }\n") == []


def test_a_blind_safeguard_can_be_held_back_by_another_one() -> None:
    text = CARRY.replace("when bumper }", "when sonar < 500 mm }")
    told = messages(text + "network { drive = (carry inhibits avoid) suppresses cruise }\n")
    [message] = [m for m in told if "cruise" in m]
    assert message.startswith("with `sonar` missing, `cruise` can drive: `carry`, which is failsafe, ")


def test_an_inhibitor_of_an_inhibitor() -> None:
    text = go("cruise", "true") + "module near { when level > 50 }\nfailsafe module carry { when bumper }\n"
    assert len(hints(text + "network { drive = (carry inhibits near) inhibits cruise }\n")) == 1


# --- memory ----------------------------------------------------------------------------------------

MODE = "machine mode { start going  going -> turning when bumper  turning -> going when not bumper }\n"
MODES = go("go", "mode == mode.going") + go("turn", "mode == mode.turning", "0", "30 deg/s")
TURNING = MODE + MODES + "network { drive = turn suppresses go }\n"


def test_a_machine_that_cannot_leave_a_phase() -> None:
    assert found(TURNING) == [("V030", "with `bumper` missing, `mode` cannot leave `going`, and `go` drives")]
    assert hints(TURNING) == [
        "write `failsafe going -> turning when ...`, or wire a module `when not fresh(bumper)` that "
        "inhibits `go`"
    ]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("  going -> turning", "  failsafe going -> turning", 0),  # the cure
        ("when bumper", "when level > 50", 0),  # never missing
        ("when bumper", "when value_or(bumper, true)", 0),
        ("when bumper", "when sonar < 1 m", 1),
        ("when bumper", "when level > 50 and bumper", 1),
        ("  going -> turning", "  going -> going when sonar < 1 m  going -> turning", 2),  # it is above
        ("  going -> turning", "  failsafe going -> going when sonar < -1 m  going -> turning", 1),
        ("drive(velocity = 300 mm/s", "drive(velocity = 0 mm/s", 1),  # `go` stands, `turn` turns
        ("when mode == mode.going", "when mode == mode.going or not bumper", 0),  # it needs the sensor itself
        ("drive(velocity = 0, turn = 30 deg/s)", "drive(velocity = 300 mm/s, turn = 0)", 0),  # no safeguard
        ("drive(velocity = 0, turn = 30 deg/s)", "drive(velocity = 299 mm/s, turn = 0)", 1),
        ("drive(velocity = 0, turn = 30 deg/s)", "drive(velocity = -100 mm/s, turn = 0)", 1),
        ("network { drive = turn suppresses go }",
         "module b { when not fresh(bumper) } network { drive = b inhibits (turn suppresses go) }", 0),
        ("network { drive = turn suppresses go }", "network { drive = go }", 1),
        ("machine mode", "let moving = mode == mode.going machine mode", 1),
    ],
)  # fmt: skip
def test_which_machines_are_found(old: str, new: str, expected: int) -> None:
    assert old in TURNING
    told = messages(TURNING.replace(old, new, 1))
    assert sum(message.count("cannot leave") + message.count("` or `") for message in told) == expected


@pytest.mark.parametrize(
    ("mode", "limit", "expected"), [("keep", "", 1), ("restart", "", 1), ("keep", "within 1 s else done", 0)]
)
def test_a_task_that_cannot_end_and_has_no_time_limit(mode: str, limit: str, expected: int) -> None:
    job = f"sequence job {mode} {{ a = go until bumper {limit} b = turn until true }}\n"
    tasks = go("go", "true") + go("turn", "true", "0", "30 deg/s") + job + "network { drive = job.drive }\n"
    message = "with `bumper` missing, `job` cannot leave `a`, and `job.a` drives"
    assert messages(tasks).count(message) == expected
    hint = "give the task a time, `within 30 s else PHASE`, or wire a module"
    assert sum(text.startswith(hint) for text in hints(tasks)) == expected


def test_machines_are_read_through_lets() -> None:
    text = "let moving = mode == mode.going\n" + TURNING.replace(
        "when mode == mode.going", "let m = moving when m"
    )
    assert codes(text) == ["V030"]


def test_a_machine_that_a_dominator_reads() -> None:
    text = MODE + go("cruise", "true") + go("halt", "mode == mode.turning", "0")
    wired = text + "network { drive = halt suppresses cruise }\n"
    message = "with `bumper` missing, `mode` cannot leave `going`, and `cruise` drives"
    assert found(wired) == [("V030", message)]
    assert hints(wired.replace("  going ->", "  failsafe going ->")) == []


def test_a_state_that_stays_as_it_is() -> None:
    text = "state stopped = false next stopped = stopped or bumper\n" + go("cruise", "not stopped")
    text += "network { drive = cruise }\n"
    assert found(text) == [("V030", "with `bumper` missing, `stopped` stays as it is, and `cruise` drives")]
    assert hints(text) == ["wire a module `when not fresh(bumper)` that inhibits `cruise`"]
    assert hints(text.replace("stopped or bumper", "stopped or value_or(bumper, true)")) == []
    assert hints(text.replace("stopped or bumper", "stopped or level > 50")) == []


def test_a_state_that_only_lets_a_module_begin() -> None:
    text = "state begun = false next begun = begun or bumper\n" + go("cruise", "begun")
    assert codes(text + "network { drive = cruise }\n") == []


def test_memory_that_changes_a_command_only() -> None:
    text = "state v : mm/s = 300 mm/s next v = if bumper then 0 mm/s else v\n" + go("cruise", "true", "v")
    assert codes(text + "network { drive = cruise }\n") == []


def test_memory_of_memory_functions_in_a_transition() -> None:
    text = TURNING.replace(
        "when bumper", "when recently(bumper, 1 s) and elapsed(mode == mode.going) > 50 ms", 1
    )
    assert [m for _, m in found(text)] == [
        "with `bumper` missing, `mode` cannot leave `going`, and `go` drives"
    ]


def test_a_machine_that_comes_late_to_the_phase() -> None:
    machine = """machine mode {
  start off  off -> armed when level > 50  armed -> ready when level < 50  ready -> going when level > 60
  going -> done when bumper
}
"""
    text = machine + go("go", "mode == mode.going") + "network { drive = go }\n"
    assert messages(text) == ["with `bumper` missing, `mode` cannot leave `going`, and `go` drives"]


def test_a_state_that_counts() -> None:
    text = "state bumps = 0 next bumps = if rising(bumper) then bumps + 1 else bumps\n"
    text += go("retire", "bumps >= 2", "0") + go("cruise", "true")
    text += "network { drive = retire suppresses cruise }\n"
    assert messages(text) == ["with `bumper` missing, `bumps` stays as it is, and `cruise` drives"]


# --- modules in Python -----------------------------------------------------------------------------

LAMP = robot("actuator lamp { on : bool } to RServer.lamp idle lamp(on = false)")
PYTHON = 'module p from python "behaviors:P" { reads sonar }\n'


def test_a_safeguard_in_python_is_silent_without_its_sensor() -> None:
    text = go("cruise", "true") + PYTHON + "network { drive = p inhibits cruise }\n"
    assert messages(text) == ["with `sonar` missing, `cruise` can drive: `p`, which reads it, is silent then"]
    assert hints(text.replace("module p", "failsafe module p")) == []


def test_a_module_in_python_does_not_hide_what_others_do() -> None:
    expected = "with `sonar` missing, `cruise` can drive: `avoid`, which reads it, is silent then"
    elsewhere = PYTHON.replace("sonar }", "sonar commands lamp }")
    lit = "network { drive = avoid suppresses cruise\n lamp = p }\n"
    assert [m for code, m in found(AVOID + elsewhere + lit, LAMP) if code == "V030"] == [expected]
    above = PYTHON.replace("sonar }", "sonar commands drive }")
    network = "network { drive = p suppresses avoid suppresses cruise }\n"
    assert messages(AVOID + above + network) == [expected]


def test_a_failsafe_module_in_python_holds_a_safeguard_back() -> None:
    text = AVOID.replace("module avoid", "failsafe module avoid")
    text += "failsafe " + PYTHON.replace("sonar", "bumper")
    [message] = messages(text + "network { drive = (p inhibits avoid) suppresses cruise }\n")
    assert message.endswith(": `p`, which is failsafe, is active then and holds back `avoid`")


# --- how far is looked -----------------------------------------------------------------------------


def test_a_module_that_drives_in_a_late_phase() -> None:
    phases = "p -> q when level > 1  q -> r when level > 2  r -> z when level > 3"
    text = f"machine m {{ start p  {phases} }}\n" + go("cruise", "m == m.z") + go("stop", "bumper", "0")
    assert len(messages(text + "network { drive = stop suppresses cruise }\n")) == 1


def test_each_of_two_transitions_to_one_phase() -> None:
    stops = "go -> stop when sonar < 1 m  go -> stop when bumper"
    machine = f"machine m {{ start go  {stops}  stop -> go when level > 5 }}\n"
    text = go("move", "m == m.go") + "network { drive = move }\n"
    assert messages(machine + text) == [
        "with `sonar` or `bumper` missing, `m` cannot leave `go`, and `move` drives"
    ]
    half = machine.replace("go -> stop when sonar", "failsafe go -> stop when sonar")
    assert messages(half + text) == ["with `bumper` missing, `m` cannot leave `go`, and `move` drives"]


@pytest.mark.long
def test_what_is_too_far_away_is_said_to_be_undecided() -> None:
    late = "state n : number = 0\nnext n = if rising(level > 50) then n + 1 else n\n" + go(
        "cruise", "n > 1000"
    )
    text = late + go("stop", "bumper", "0") + "network { drive = stop suppresses cruise }\n"
    [undecided] = [d for d in linted(ROBOT + text + USES) if d.code == "V035"]
    assert undecided.severity == "note"
    assert undecided.message.startswith(
        "whether `cruise` can drive with `bumper` missing is unknown: no run of "
    )
    assert undecided.hint == "state it: `contract still: not fresh(bumper) implies drive is idle`"


def test_the_cure_is_the_transition_as_it_is_written() -> None:
    machine = "machine m { start go  any -> stop when bumper  stop -> go when level > 5 }\n"
    [hint] = hints(machine + go("move", "m == m.go") + "network { drive = move }\n")
    assert hint.startswith("write `failsafe any -> stop when ...`, or ")
