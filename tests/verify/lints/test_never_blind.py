"""Lint of failsafe modules that missing sensors do not make blind."""

from __future__ import annotations

import pytest

from tests.verify.lints.programs import USES, linted
from tests.verify.small_robot import robot

ROBOT = robot("sensor near : bool from RServer.front_bumper within 300 ms")


def notes(module: str) -> list[tuple[str, str, str | None]]:
    """Message, severity and hint of the notes on a module."""
    text = ROBOT + module + "\nnetwork { drive = m }\n" + USES
    return [(d.severity, d.message, d.hint) for d in linted(text) if d.code == "V032"]


DO = "do drive(velocity = 0, turn = 0) }"


@pytest.mark.parametrize(
    "module",
    [
        f"failsafe module m {{ when near {DO}",
        f"failsafe module m {{ when bumper and near {DO}",
        f"failsafe module m {{ let x = near when level > 50 {DO}",
        f"let x = near failsafe module m {{ when x {DO}",
        f"module m {{ when bumper {DO}",
        f"module m {{ when level > 50 {DO}",
        'failsafe module m from python "nowhere:Nothing" { reads level commands drive }',
    ],
)
def test_a_module_that_can_be_blind_gets_no_note(module: str) -> None:
    assert notes(module) == []


def test_a_module_whose_sensors_have_defaults() -> None:
    [(severity, message, hint)] = notes(f"let l = level failsafe module m {{ when l > 50 {DO}")
    assert severity == "note"
    assert message == "`m` is failsafe, but never goes blind: nothing that it needs can be missing"
    because = "`level` has a default, which stands in for a missing reading"
    assert hint == f"{because}: ask `fresh(level)`, or remove `failsafe`"


@pytest.mark.parametrize("when", ["true", "not fresh(near)", "value_or(near, true)"])
def test_a_module_that_needs_nothing(when: str) -> None:
    [(_, message, hint)] = notes(f"failsafe module m {{ when {when} {DO}")
    assert message == "`m` is failsafe, but never goes blind: nothing that it needs can be missing"
    assert hint == "remove `failsafe`"


def test_a_module_whose_sensors_never_get_too_old() -> None:
    [(severity, message, hint)] = notes(f"failsafe module m {{ when bumper and sonar < 1 m {DO}")
    assert severity == "note"
    assert message == (
        "`m` is failsafe, but goes blind only where `bumper` and `sonar` have no value at all: "
        "their readings never get too old"
    )
    assert hint == "declare `bumper` and `sonar` with a `within`"


def test_a_derived_module_is_failsafe_too() -> None:
    text = f"module base {{ param p = 1 when level > p {DO}\nfailsafe module m = base(p = 2)"
    assert len(notes(text)) == 1
