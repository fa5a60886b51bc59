"""The description that a robot is served with: which one is taken for it, by its interface."""

from __future__ import annotations

import msgspec
import pytest

from colony.dsl.descriptions import RobotChoice
from colony.runs.described import NoDescriptionError, described_program, served_program
from colony.runtime.protocol.interface import Interface, interface_of
from colony.text.diagnostics import DiagnosticError

ROME, AMR = (RobotChoice(text=name, origin="the test") for name in ("rome", "amr"))


def by_name(name: str) -> RobotChoice:
    return RobotChoice(text=name, origin="the test", is_name=True)


def interface(served: RobotChoice | None) -> Interface:
    return Interface() if served is None else interface_of(described_program(served).robot)


@pytest.mark.parametrize(
    ("choice", "served"), [(by_name("rome"), ROME), (by_name("lab"), ROME), (AMR, AMR), (ROME, None)]
)
def test_the_description_is_the_one_of_the_robot(choice: RobotChoice, served: RobotChoice | None) -> None:
    assert served_program(interface(served), choice).robot.name == (served or ROME).text


@pytest.mark.parametrize(
    ("choice", "served", "message"),
    [
        (AMR, ROME, "is `rome`, not `amr`"),
        (by_name("lab"), None, "is served without a description"),
        (by_name("rome"), None, "is served without a description"),
    ],
)
def test_no_other_description_is_taken_for_it(
    choice: RobotChoice, served: RobotChoice | None, message: str
) -> None:
    with pytest.raises(NoDescriptionError, match=message):
        served_program(interface(served), choice)


@pytest.mark.parametrize("name", ["../rome", "robots/rome", "rome.colony", "nowhere", ""])
def test_what_a_robot_calls_its_description_is_no_path(name: str) -> None:
    called = msgspec.structs.replace(interface(ROME), robot=name)
    with pytest.raises(NoDescriptionError, match="is not found"):
        served_program(called, by_name("lab"))


def test_an_unknown_description_is_shown_in_the_option_that_names_it() -> None:
    choice = RobotChoice(text="romme", origin="--robot h1=romme")
    with pytest.raises(DiagnosticError) as failed:
        described_program(choice)
    [problem] = failed.value.diagnostics
    assert (str(problem.span), problem.span.text, problem.hint) == (
        "--robot:1:4",
        "romme",
        "did you mean `rome`?",
    )
