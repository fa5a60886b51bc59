"""What may stand at a place, of what is being written there."""

from __future__ import annotations

import pytest

from tests.editing.project import PATROL, Project


@pytest.mark.parametrize(
    ("right", "typed", "first", "others", "absent"),
    [
        # values where an expression stands, its module's own first
        ("  when close", "  when |", "close", {"ahead", "sonar", "bumper", "not", "near", "min"}, {"avoid"}),
        # lets below are not known yet
        ("* 450 mm", "* 450 mm\nlet early = |", "bumper", {"room", "sonar", "mode"}, {"ahead", "close"}),
        ("r < limit", "r < |", "limit", {"r", "room"}, {"near"}),
        # members
        ("mode.roaming\n", "mode.|\n", "resting", {"roaming"}, {"sonar"}),
        ("avoid.close\n", "avoid.|\n", "close", set(), {"sonar"}),
        ("drive.turn > 0", "drive.|", "turn", {"velocity"}, {"sonar"}),
        ("drive.turn > 0", "last.drive.|", "turn", {"velocity"}, {"sonar"}),
        ("drive.turn > 0", "last.|", "avoid", {"drive", "cruise"}, {"sonar"}),
        # fields that are not given yet, names of params and inputs
        ("drive(velocity = speed, turn = 0)", "drive(velocity = speed, |", "turn", set(), {"velocity"}),
        ("cruise(speed = 100 mm/s)", "cruise(|", "speed", set(), {"ahead"}),
        ("near(ahead, limit = room)", "near(ahead, |", "limit", {"room"}, set()),
        # modules and wires, actuators, states, phases
        ("= avoid suppresses gentle", "= |", "avoid", {"cruise", "pause", "roam"}, {"sonar", "ahead"}),
        (
            "roam  = avoid suppresses gentle suppresses cruise",
            "roam  = avoid |",
            "drive",
            {"suppresses", "inhibits"},
            {"do"},
        ),
        ("do   drive(velocity = speed", "do   |", "drive", set(), {"avoid", "sonar"}),
        ("next  bumps =", "next  |", "bumps", set(), {"mode"}),
        ("roaming -> resting", "roaming -> |", "resting", {"roaming"}, {"sonar"}),
        ("drive by avoid implies", "drive by |", "avoid", {"cruise", "gentle"}, {"sonar", "drive"}),
        ("expect drive by avoid, avoid.close", "expect drive |", "and", {"by", "is"}, {"sonar"}),
        ("given sonar = 3 m", "given |", "bumper", {"sonar", "paused"}, {"drive"}),
        # units, the fitting ones first; types
        ("drive.velocity <= 100 mm/s", "drive.velocity <= 100 |", "m/s", {"mm/s", "deg"}, {"sonar"}),
        ("limit : mm = 900 mm", "limit : |", "bool", {"number", "goal", "mm", "deg"}, {"sonar"}),
        ("turn = 0)\n}\nmodule gentle", "turn = 3 |)\n}\nmodule gentle", "deg/s", {"rad/s"}, {"sonar"}),
        # declarations
        ("reach turns: drive.turn > 0\n", "|\n", "assume", {"contract", "let", "module", "test"}, {"sonar"}),
        ("let ahead = min", "let |", "", set(), {"sonar", "when"}),
    ],
)
def test_completion_offers_what_may_stand_there(
    project: Project, right: str, typed: str, first: str, others: set[str], absent: set[str]
) -> None:
    project.replace(project.uri, right, typed.replace("|", ""))
    offset = project.texts[project.uri].index(typed.replace("|", ""), PATROL.index(right)) + typed.index("|")
    found = project.completions_at(project.uri, offset)
    assert (found[:1] or [""]) == [first]
    assert others <= set(found), others - set(found)
    assert not absent & set(found)


def test_completion_within_a_word_that_is_being_typed(project: Project) -> None:
    project.replace(project.uri, "when close", "when clo")
    assert project.completions(project.uri, "when clo|")[0] == "close"


def test_clauses_are_offered_in_a_module(project: Project) -> None:
    project.replace(project.uri, "  when close", "  ")
    found = project.completions(project.uri, "limit = room)\n  |\n")
    assert {"when", "let", "state", "param", "input", "next"} <= set(found)


def test_nothing_is_offered_in_comments_and_files_after_import(project: Project) -> None:
    assert project.completions(project.uri, "# What is str|aight") == []
    project.replace(project.uri, "import robot", 'import "')
    found = project.completions(project.uri, 'import "|')
    assert {"rome", "wander", "functions"} <= set(found)
    project.replace(project.uri, 'import "', 'import robot\ntest "')
    assert project.completions(project.uri, 'test "|\n\nenum') == []


def test_names_behind_an_alias_are_offered(project: Project) -> None:
    project.replace(project.uri, "import robot", 'import robot\nimport "wander" as wander')
    project.settle()
    project.replace(project.uri, "when mode == mode.roaming", "when wander.")
    found = project.completions(project.uri, "when wander.|")
    assert {"room_left", "avoid"} <= set(found)
    assert "sonar" not in found
