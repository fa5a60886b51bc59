"""Running `test` blocks, and what is said where one fails."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import check_file, load_text
from colony.text.diagnostics import headline, render
from colony.verify.testing.examples import ExampleResult, failures_as_diagnostics, run_examples
from tests.programs import robot
from tests.verify.scripted_modules import Scripted

BEHAVIOR = """
robot r {
  sensor sonar[4] : m range 0 .. 10 from PServer.sonar
  sensor bumper : bool from RServer.bumper
  sensor spare[2] : number default 3 from DServer.spare
  sensor where_to : mm default 5 m from DServer.where_to
  actuator drive { speed : m/s range -1 .. 1 } to RServer.drive idle drive(speed = 0)
}
enum light { off = 0, green = 2 }
let ahead = min(sonar)
module cruise { when ahead > 1 m do drive(speed = 0.3 m/s) }
module back_off { when recently(bumper, 2 s) do drive(speed = -0.2 m/s) }
network { drive = back_off suppresses cruise }
contract never_fast: drive.speed <= 0.25 m/s or not bumper or true
"""


def results(text: str, behavior: str = BEHAVIOR) -> list[ExampleResult]:
    return list(run_examples(load_text(behavior + text)))


def failed(text: str, behavior: str = BEHAVIOR) -> list[str]:
    """The headline of every failure, without the file name."""
    return [headline(d).split(": ", 1)[1] for d in failures_as_diagnostics(results(text, behavior))]


def test_a_good_example() -> None:
    [result] = results("""
      test "backs off for two seconds" {
        at 0 s   given sonar = 3 m, bumper = true  expect drive by back_off, back_off is active
        from 0.1 s to 1.9 s every 100 ms given bumper = false expect drive by back_off, drive.speed < 0
        at 2 s                                     expect drive by cruise
        at 3 s   given sonar[1] = 50 cm            expect drive is idle, ahead == 50 cm
        at 4 s   given sonar = [2 m, 3, 4, 5 m]    expect ahead == 2 m, drive is commanded
        at 5 s   given sonar = missing             expect drive is idle, not fresh(ahead)
      }
    """)
    assert result.passed, result
    assert result.name == "backs off for two seconds"
    assert result.frames == 24


def test_each_example_starts_anew() -> None:
    text = """
      test "one" { at 0 s given bumper = true, sonar = 3 expect drive by back_off }
      test "two" { at 0.1 s given bumper = false, sonar = 3 expect drive by cruise }
    """
    assert [r.passed for r in results(text)] == [True, True]


def test_given_values_reach_the_program_unrounded() -> None:
    given = "given where_to = 0.1 ft, sonar = 0.1 inch"
    assert results(f'test "t" {{ at 0 s {given} expect where_to == 0.1 ft, ahead == 0.1 inch }}')[0].passed


FAILED = {
    "an expectation": (
        BEHAVIOR,
        "at 0.5 s given sonar = 3 m, bumper = false expect drive by back_off",
        'T001]: in "t" at 0.5 s: expected `drive by back_off`; found: drive by cruise, speed = 0.3 m/s',
    ),
    "what an expectation reads": (
        BEHAVIOR,
        "at 0 s given sonar = 3 m, bumper = true "
        "expect ahead < 2 m and bumper and fresh(bumper) and cruise is active and sonar[1] > 0 mm",
        "ahead = 3000 mm; bumper = true; bumper is fresh; cruise is active; sonar = [3 m, 3 m, 3 m, 3 m]",
    ),
    "an expectation that says nothing": (
        BEHAVIOR,
        "at 0 s expect ahead > 1 m",
        'T002]: in "t" at 0 s: `ahead > 1 m` is unknown; found: `ahead` is missing since `sonar` is',
    ),
    "a step": (
        BEHAVIOR,
        "from 0 s to 1 s every 100 ms given sonar = 3 m, bumper = false expect drive is idle",
        'in "t" at 0 s, and in 10 more frames: expected `drive is idle`',
    ),
    "a contract": (
        BEHAVIOR + "contract ahead_only: drive.speed > 0 m/s\n",
        "from 0 s to 0.2 s every 100 ms given sonar = 3 m, bumper = true expect drive by back_off",
        'T003]: in "t" at 0 s, and in 2 more frames: contract `ahead_only: drive.speed > 0 m/s` is false; '
        "found: drive by back_off, speed = -0.2 m/s",
    ),
    "a record": (
        BEHAVIOR.replace("back_off suppresses", "bad suppresses")
        + "module bad { when bumper do drive(speed = 1 m/s / (1 - 1)) }\n",
        "at 0 s given bumper = true expect drive is commanded",
        "drive by bad (not finite), speed = 0 m/s; recorded: not finite of bad",
    ),
}


@pytest.mark.parametrize(("behavior", "steps", "said"), FAILED.values(), ids=FAILED)
def test_what_fails_says_where_and_what_was_found(behavior: str, steps: str, said: str) -> None:
    [message] = failed(f'test "t" {{ {steps} }}', behavior)
    assert said in message


@pytest.mark.parametrize(
    ("condition", "hint"),
    [
        ("bumper implies drive.speed > 0 m/s", "give `bumper` in the test, or say in the contract"),
        ("bumper implies drive.speed > 0 m/s", "what a missing one stands for: `value_or(bumper, ...)`"),
        ("ahead > 1 m and bumper", "give `sonar` and `bumper` in the test"),
        ("value_or(ahead, 1 m) > 0 m and bumper", "give `bumper` in the test"),
    ],
)
def test_a_contract_that_is_unknown_names_the_sensors_to_give(condition: str, hint: str) -> None:
    program = load_text(f'{BEHAVIOR}contract c: {condition}\ntest "t" {{ at 0 s expect drive is idle }}')
    found = failures_as_diagnostics(run_examples(program))
    [diagnostic] = [d for d in found if d.code == "T003"]
    assert "is unknown; found: " in diagnostic.message
    assert hint in str(diagnostic.hint)
    assert diagnostic.labels == ()


def test_a_contract_that_is_false_has_no_hint() -> None:
    program = load_text(f'{BEHAVIOR}contract c: bumper\ntest "t" {{ at 0 s given bumper = false }}')
    [diagnostic] = failures_as_diagnostics(run_examples(program))
    assert (diagnostic.code, diagnostic.hint) == ("T003", None)


def test_a_contract_of_another_file_shows_the_test(tmp_path: Path) -> None:
    (tmp_path / "robot.colony").write_text(f"{BEHAVIOR}contract c: bumper")
    path = tmp_path / "top.colony"
    path.write_text('import "robot.colony"\ntest "t" { at 0 s given bumper = false }')
    program = check_file(path).program
    assert program is not None
    [diagnostic] = failures_as_diagnostics(run_examples(program))
    assert diagnostic.span.source.name.endswith("robot.colony")
    [label] = diagnostic.labels
    assert label.text == "in this test"
    assert label.span.source.name.endswith("top.colony")


@pytest.mark.parametrize(
    ("condition", "quoted"),
    [
        ("drive.speed < 1 m/s and (sum(sonar) < 1 m)", "drive.speed < 1 m/s and (sum(sonar) < 1 m)"),
        ("((ahead + 0 m) * 1) < 1 m", "((ahead + 0 m) * 1) < 1 m"),
        ("not (bumper or ((ahead > 1 m)))", "not (bumper or ((ahead > 1 m)))"),
        ("bumper or  # :-)\n  ahead < 1 m", "bumper or ahead < 1 m"),
    ],
)
def test_conditions_are_quoted_with_all_of_their_parentheses(condition: str, quoted: str) -> None:
    behavior = f"{BEHAVIOR}contract c: {condition}\n"
    [message] = failed('test "t" { at 0 s given sonar = 3 m, bumper = false }', behavior)
    assert f"contract `c: {quoted}` is false" in message


def test_an_element_can_be_set_only_in_an_array_that_is_there() -> None:
    text = """
      test "t" {
        at 0 s given sonar[1] = 3 m
        at 1 s given sonar = 2 m
        at 2 s given sonar[1] = 3 m expect ahead == 2 m, sonar[1] == 3 m
        at 3 s given sonar = missing
        at 4 s given sonar[0] = 1 m
        at 5 s given spare[0] = 1
      }
    """
    messages = failed(text)
    assert [m.split(":")[1].strip() for m in messages] == [
        'in "t" at 0 s',
        'in "t" at 4 s',
        'in "t" at 5 s',
    ]
    assert all(m.startswith("error[T004]") for m in messages)
    [first, _, last] = failures_as_diagnostics(results(text))
    assert "assign the whole array first: `sonar = ...`" in render(first)
    assert "the sensor's default does not count" in render(last)


AGING = """
robot r {
  sensor lidar : m from PServer.lidar within 300 ms
  sensor sonar[3] : m from PServer.sonar within 300 ms
  sensor bumper : bool default false from RServer.bumper within 300 ms
  actuator drive { speed : m/s } to RServer.drive idle drive(speed = 0)
}
"""


READING = """
test "t" {
  at 1 s            given lidar = 5 m taken 300 ms ago  expect lidar == 5 m
  at 1.000000001 s                                      expect not fresh(lidar)
  at 2 s            given lidar = 4 m                   expect lidar == 4 m
  at 9 s                                                expect fresh(lidar)
  from 10 s to 11 s every 1 ms
    given lidar = 3 m taken 0 s ago, bumper = true taken 300 ms ago
    expect fresh(lidar) == (now <= 9.3 s), bumper == (now == 9 s), fresh(bumper) == bumper
  at 12 s           given lidar = missing               expect not fresh(lidar)
  at 13 s           given lidar = 2 m                   expect fresh(lidar)
}
"""
ELEMENT = """
test "t" {
  at 0 s    given sonar = 5 m                                                expect fresh(sonar)
  at 1 s    given sonar[1] = 1 m taken 200 ms ago                            expect sonar[1] == 1 m
  at 1.1 s  given sonar[2] = 2 m                                             expect sonar[2] == 2 m
  at 1.2 s                                                                   expect not fresh(sonar)
  at 2 s    given sonar = [1, 2, 3] taken 100 ms ago, sonar[0] = 9           expect sonar[0] == 9 m
  at 2.3 s                                                                   expect not fresh(sonar)
  at 3 s    given sonar = [1, 2, 3] taken 1 s ago, sonar = 4                 expect sonar[0] == 4 m
  at 9 s                                                                     expect fresh(sonar)
}
"""


@pytest.mark.parametrize("text", [READING, ELEMENT], ids=["until it is given again", "that of its array"])
def test_a_reading_and_an_element_age_from_when_they_were_taken(text: str) -> None:
    [result] = results(text, AGING)
    assert result.passed, result


def test_no_element_can_be_set_in_an_array_that_is_too_old() -> None:
    test = """
      test "t" {
        at 0 s  given sonar = 5 m taken 0 s ago
        at 1 s  given sonar[1] = 1 m taken 0 s ago
      }
    """
    [message] = failed(test, AGING)
    assert message == ('error[T004]: in "t" at 1 s: `sonar` is missing, so none of its elements can be set')


def test_an_element_that_cannot_be_set_leaves_no_age() -> None:
    first, second = failed(
        'test "t" { at 0 s given sonar[1] = 1 m taken 9 s ago expect sonar[0] > 0 m }', AGING
    )
    assert first.startswith("error[T004]")
    assert second.endswith("found: `sonar` is missing")


def test_enumerators_and_idle_hold_are_shown() -> None:
    [first, second] = failed(
        """
        test "t" { at 0 s given feel = mood.alert expect feel == mood.calm, out is commanded }
        """,
        robot(),
    )
    assert first.endswith("found: feel = mood.alert")
    assert second.endswith("found: out is idle, nothing sent so far")


def test_long_arrays_are_abridged() -> None:
    behavior = "robot r { sensor many[24] : number bearing -180 deg from DServer.many }"
    given = "at 0 s given many = 1, many[-15 deg] = 2"
    [message] = failed(f'test "t" {{ {given} expect many[0 deg] > 1 }}', behavior)
    assert message.endswith("many = all 1, [-15 deg] 2")
    given = f"at 0 s given many = [{', '.join(map(str, range(24)))}]"
    [message] = failed(f'test "t" {{ {given} expect many[0 deg] > 12 }}', behavior)
    assert message.endswith("many = [0, 1, 2, 3, 4, 5, 6, 7, ...]")


SILENT = """
robot r {
  sensor lidar : m from PServer.lidar within 300 ms
  sensor sonar[4] : m from PServer.sonar
  sensor bumper : bool from RServer.bumper
  sensor spare : number default 3 from DServer.spare
  sensor chance : number from Runtime.random
  actuator drive { speed : m/s } to RServer.drive idle drive(speed = 0)
  actuator lamp { on : bool } to DServer.lamp idle hold
}
let near = min(sonar)
let ahead = min(near, lidar)
module cruise { when true do drive(speed = 0.3 m/s) }
module wander { let c = chance when c > 0.5 and bumper do drive(speed = 0.2 m/s) }
failsafe module avoid { when ahead < 1 m and spare > 2 do drive(speed = 0.1 m/s) }
module halt { when near < 0.1 m }
module below { state n = 0 next n = n + chance when true do drive(speed = 0.1 m/s) }
module beside { when chance > 0 do lamp(on = true) }
network {
  roam  = wander suppresses cruise suppresses below
  drive = halt inhibits (avoid suppresses roam)
  lamp  = beside
}
"""

CLEAR = "sonar = 9, lidar = 5, bumper = false, chance = 0"
WANDER = "`wander` is silent: `chance` is missing"
AVOID = "`avoid` is blind: `ahead` is missing since `sonar` is"
HALT = "`halt` is silent: `near` is missing since `sonar` is"


@pytest.mark.parametrize(
    ("given", "expected", "reasons"),
    [
        (CLEAR, "drive by wander", []),
        # modules that are named, and those that would win, or keep the winner from winning
        (f"{CLEAR}, chance = missing", "drive by wander", [WANDER]),
        (f"{CLEAR}, chance = missing", "drive is idle", [WANDER]),
        (f"{CLEAR}, chance = missing", "drive.speed < 0 m/s", [WANDER]),
        (
            f"{CLEAR}, chance = missing",
            "drive by below",
            ["`below` is silent: `chance` is missing", WANDER],
        ),
        (f"{CLEAR}, chance = missing", "not (roam is active)", []),
        (f"{CLEAR}, sonar = missing", "drive by cruise", [AVOID, HALT]),
        (f"{CLEAR}, sonar = missing", "not (avoid is active)", [AVOID]),
        (f"{CLEAR}, sonar = missing", "lamp by beside", []),
        (f"{CLEAR}, chance = missing", "lamp is commanded", ["`beside` is silent: `chance` is missing"]),
        # down to the sensors
        ("chance = 1", "wander is active", ["`wander` is silent: `bumper` is missing"]),
        (
            "bumper = true",
            "avoid is active and bumper and false",
            ["`avoid` is blind: `ahead` is missing since `sonar` and `lidar` are"],
        ),
        (
            f"{CLEAR}, lidar = 5 taken 2 s ago",
            "not (avoid is active)",
            ["`avoid` is blind: `ahead` is missing since `lidar` is too old (2 s)"],
        ),
        (
            f"{CLEAR}, sonar = missing, lidar = 5 taken 2 s ago",
            "not (avoid is active)",
            ["`avoid` is blind: `ahead` is missing since `sonar` is missing and `lidar` is too old (2 s)"],
        ),
    ],
)
def test_a_failure_says_why_modules_are_silent_or_blind(
    given: str, expected: str, reasons: list[str]
) -> None:
    [message] = failed(f'test "t" {{ at 0 s given {given} expect {expected} }}', SILENT)
    said = message.split("; found: ")[1].split("; ")
    assert [part for part in said if part.startswith("`")] == reasons


@pytest.mark.parametrize(
    ("expected", "found"),
    [
        ("sonar[0] > 0 m", "`sonar` is missing"),
        ("lidar > 0 m", "`lidar` is too old (400 ms)"),
        ("ahead > 0 m", "`ahead` is missing since `sonar` is missing and `lidar` is too old (400 ms)"),
        ("near > 0 m", "`near` is missing since `sonar` is"),
        ("wander.c > 0", "wander.c is missing; `wander` is silent: `chance` and `bumper` are missing"),
    ],
)
def test_an_expectation_that_says_nothing_says_which_name_is_missing(expected: str, found: str) -> None:
    [message] = failed(f'test "t" {{ at 0 s given lidar = 5 taken 400 ms ago expect {expected} }}', SILENT)
    assert message.endswith(f"; found: {found}")


def test_a_winner_that_is_blind_is_shown() -> None:
    [message] = failed(
        f'test "t" {{ at 0 s given {CLEAR}, sonar = missing expect drive is commanded }}', SILENT
    )
    assert f"found: drive by avoid (missing), speed = 0 m/s; {AVOID}; {HALT}" in message


def test_a_module_in_python_is_blind_until_it_answers() -> None:
    guess = """
      failsafe module guess from python "tests.verify.scripted_modules:Scripted" {
        reads chance  commands lamp  rate 100 ms
      }
    """
    behavior = SILENT.replace("module beside { when chance > 0 do lamp(on = true) }", guess)
    Scripted.answers = [None]
    [message] = failed(
        f'test "t" {{ at 0 s given {CLEAR} expect lamp is commanded }}', behavior.replace("beside", "guess")
    )
    assert message.endswith(
        "found: lamp by guess (missing), nothing sent so far; `guess` is blind: it has no answer"
    )
